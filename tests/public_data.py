"""Public measured records by name: found on this machine, or fetched and checked.

The registry of the checkout, `data/public.toml`, has for each record its path in the data
folder, source, licence, SHA-256 and, where one is known, a URL. Tests are skipped, with a message,
where records are not to be had.
"""

import hashlib
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path

import pytest

from jaxfric.errors import InputError

_CHECKOUT = Path(__file__).resolve().parents[1]


def public_record(name: str) -> Path:
    """Path of a public record on this machine; skips the test where there is none."""
    if data_folder() is None:
        pytest.skip(f"{name}: no public records here (JAXFRIC_DATA or ../shared/data)")
    return public_path(name)


def public_path(name: str, *, registry: str | Path | None = None) -> Path:
    """Path of the public record `name`, with its SHA-256 verified.

    Looked for in the folder of the environment variable JAXFRIC_DATA, else in
    `../shared/data` beside the checkout, else fetched from its URL by pooch.

    **Arguments:** `registry`: a file as `data/public.toml`, which is the default.

    Raises `InputError` where the name is unknown, the file is nowhere to be had, or its
    contents are not those of the registry.
    """
    entry = _entry(name, Path(registry) if registry else _CHECKOUT / "data" / "public.toml")
    folder = data_folder()
    local = folder / entry["path"] if folder else None
    if local is not None and local.is_file():
        if hashlib.sha256(local.read_bytes()).hexdigest() != entry["sha256"]:
            raise InputError(f"{local} is not the registered {name}: its SHA-256 differs")
        return local
    if "url" not in entry:
        where = f"{folder}" if folder else "JAXFRIC_DATA (not set) or ../shared/data"
        raise InputError(f"{name} is not in {where}, and no public address of it is known")
    return _fetch(name, entry)


def data_folder() -> Path | None:
    """The folder of public records on this machine, or None."""
    named = os.environ.get("JAXFRIC_DATA")
    folder = Path(named) if named else _CHECKOUT.parent / "shared" / "data"
    return folder if folder.is_dir() else None


def _entry(name: str, registry: Path) -> Mapping[str, str]:
    try:
        entries = tomllib.loads(registry.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"there is no registry {registry}; public records need a checkout, or registry=PATH"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{registry} is not a registry of records: {error}") from None
    if name not in entries:
        raise InputError(f"'{name}' is not in {registry}; there are: {', '.join(entries)}")
    entry = entries[name]
    if not isinstance(entry, dict) or not {"path", "sha256"} <= set(entry):
        raise InputError(f"{registry}: '{name}' lacks path or sha256")
    return entry


def _fetch(name: str, entry: Mapping[str, str]) -> Path:
    try:
        import pooch
    except ImportError:
        raise InputError(f"{name} is not on this machine; to fetch it, pip install pooch") from None
    try:
        found = pooch.retrieve(
            entry["url"],
            known_hash=f"sha256:{entry['sha256']}",
            fname=name,
            path=pooch.os_cache("jaxfric"),
        )
    except Exception as error:  # no network, no such page, a wrong checksum: one line for all
        raise InputError(f"{name} could not be fetched from {entry['url']}: {error}") from None
    return Path(found)
