"""Places for a store of results: a folder, or a prefix of an object store such as S3.

No file is ever half-written: a folder uses renaming, and an object store ensures it by design. Only
one run may write to a store at a time. The operating system locks a folder. A lock file, which its
writer renews, locks an object store. If the lock file is no longer renewed, its writer was killed,
and another run may write.
"""

import contextlib
import json
import os
import re
import shutil
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, option
from ..findings import WarningCode, warned

if TYPE_CHECKING:
    from zarr.storage import ObjectStore

Tell = Callable[[str], None]
LOCK = ".lock"
_SCHEMES = ("s3", "gs", "az")
# Seconds between renewals of the lock of an object store, and until a lock counts as abandoned.
_BEAT, _ABANDONED = 10.0, 60.0


def place_of(out: str | Path) -> "Place":
    """Return the place of a path or a URL.

    Raises
    ------
    InputError : a URL of an unknown kind, or a URL whose package is not installed.
    """
    text = os.fspath(out)
    scheme, separator, rest = text.partition("://")
    if separator and scheme == "file":
        return Directory(Path(rest))
    if separator:
        if scheme not in _SCHEMES:
            known = ", ".join(f"{s}://" for s in _SCHEMES)
            raise InputError(f"{text}: no store at {scheme}://; give a folder, or one of {known}")
        return Objects(text.rstrip("/"))
    lost = re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", text)
    if lost and os.name != "nt":
        raise InputError(
            f"{text}: a URL that lost a slash on its way through a path; give it as text"
        )
    return Directory(Path(text))


class Directory:
    """A folder of a file system. File names have slashes; `shown` is the path, for messages."""

    def __init__(self, path: Path):
        self.path, self.shown = path, str(path)

    def exists(self) -> bool:
        """Whether any file is stored at this place."""
        return self.path.exists()

    def read(self, name: str) -> bytes | None:
        """Return the content of a file, or None if it does not exist."""
        try:
            return (self.path / name).read_bytes()
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            return None

    def write(self, name: str, content: bytes) -> None:
        """Create or replace a file atomically."""
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{path.name}.partial")
        partial.write_bytes(content)
        os.replace(partial, path)

    def remove(self, name: str) -> None:
        """Remove a file if it exists."""
        (self.path / name).unlink(missing_ok=True)

    def names(self, folder: str) -> list[str]:
        """Return the names of files in a folder, without the folder's name."""
        path = self.path / folder
        return sorted(os.listdir(path)) if path.is_dir() else []

    def sweep(self) -> None:
        """Remove partly written files of a killed run."""
        for partial in self.path.rglob("*.partial"):
            partial.unlink(missing_ok=True)

    def install(self, made: Callable[[str], None]) -> None:
        """Let `made` write a new store into a temporary folder, and move the store here."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(
                prefix=f".{self.path.name}-", dir=self.path.parent
            ) as work:
                made(f"{work}/store")
                os.replace(f"{work}/store", self.path)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(
                f"cannot write {self.shown}: {why}; give another with {option('out')}"
            ) from None

    def discard(self) -> None:
        """Remove the whole store."""
        shutil.rmtree(self.path, ignore_errors=True)

    def zarr(self) -> "str | ObjectStore":
        """Return the place in a form that the zarr package accepts."""
        return str(self.path)

    def faults(self) -> contextlib.AbstractContextManager[None]:
        """Turn all failures of the place into `OSError`; a file system raises no others."""
        return contextlib.nullcontext()

    @contextlib.contextmanager
    def lock(self, tell: Tell) -> Generator[None]:
        """Hold a lock of the operating system, which is released whenever the process ends.

        Raises
        ------
        InputError : another run holds the lock.
        """
        try:
            import fcntl
        except ImportError:  # this operating system has no such locks
            yield
            return
        with open(self.path / LOCK, "a") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except (BlockingIOError, PermissionError):
                raise _held(self.shown) from None
            except OSError as error:
                tell(warned(WarningCode.NO_LOCKS, store=self.shown, error=error.strerror))
            yield


class Objects:
    """A prefix of an object store, `s3://bucket/name.zarr`, through obstore; as `Directory`.

    Endpoint, region and credentials come from the environment, as AWS_ENDPOINT_URL,
    AWS_ACCESS_KEY_ID and the like.
    """

    def __init__(self, url: str):
        try:
            import obstore
        except ImportError:
            raise InputError(
                f'{url}: an object store needs obstore; install it: pip install "jaxfric[cloud]"'
            ) from None
        self.shown, self._obstore = url, obstore
        plain = os.environ.get("AWS_ENDPOINT_URL", os.environ.get("AWS_ENDPOINT", ""))
        options: dict[str, Any] = {"client_options": {"allow_http": plain.startswith("http://")}}
        options["retry_config"] = {"max_retries": 5}
        try:
            self._store = obstore.store.from_url(url, **options)
        except (obstore.exceptions.BaseError, ValueError) as error:
            raise InputError(f"{url}: {_reason(error)}") from None
        self._lost = False

    def exists(self) -> bool:
        """Whether a store exists at this place; an object store has no empty folders."""
        with self._refused():
            return self.read("zarr.json") is not None

    def read(self, name: str) -> bytes | None:
        """Return the content of a file, or None if it does not exist."""
        with self.faults():
            try:
                return bytes(self._obstore.get(self._store, name).bytes())
            except (FileNotFoundError, self._obstore.exceptions.NotFoundError):  # ty: ignore[deprecated]
                return None

    def write(self, name: str, content: bytes) -> None:
        """Create or replace a file atomically."""
        if self._lost and name != LOCK:
            raise OSError(5, "another run took the store over", self.shown)
        with self.faults():
            try:
                self._obstore.put(self._store, name, content)
            except FileNotFoundError as error:
                raise OSError(5, _reason(error), self.shown) from None

    def remove(self, name: str) -> None:
        """Remove a file if it exists."""
        with self.faults(), contextlib.suppress(FileNotFoundError):
            self._obstore.delete(self._store, name)

    def names(self, folder: str) -> list[str]:
        """Return the names of files in a folder, without the folder's name."""
        return [name.removeprefix(f"{folder}/") for name in self._below(folder)]

    def _below(self, prefix: str | None) -> list[str]:
        with self.faults():
            parts = self._obstore.list(self._store, prefix)
            return sorted(entry["path"] for part in parts for entry in part)

    def sweep(self) -> None:
        """Do nothing, because an object store has no partly written files."""

    def install(self, made: Callable[[str], None]) -> None:
        """Install a store by copying it from a local folder, with the identifying file last."""
        with tempfile.TemporaryDirectory() as work, self._refused():
            made(f"{work}/store")
            root = Path(work) / "store"
            files = sorted(f for f in root.rglob("*") if f.is_file())
            for file in sorted(files, key=lambda f: f == root / "zarr.json"):
                self.write(file.relative_to(root).as_posix(), file.read_bytes())

    def discard(self) -> None:
        """Remove the whole store, its identifying file first."""
        self.remove("zarr.json")
        for name in self._below(None):
            self.remove(name)

    def zarr(self) -> "str | ObjectStore":
        """Return the place in a form that the zarr package accepts."""
        from zarr.storage import ObjectStore

        return ObjectStore(self._store)

    @contextlib.contextmanager
    def faults(self) -> Generator[None]:
        """Turn errors of obstore into `OSError`."""
        try:
            yield
        except FileNotFoundError:
            raise
        except self._obstore.exceptions.BaseError as error:
            raise OSError(5, _reason(error), self.shown) from None

    @contextlib.contextmanager
    def _refused(self) -> Generator[None]:
        """Turn an `OSError` before the computation into an `InputError`."""
        try:
            yield
        except OSError as error:
            raise InputError(f"{self.shown}: {error.strerror}") from None

    @contextlib.contextmanager
    def lock(self, tell: Tell) -> Generator[None]:
        """Hold a lock file that names this process; the process renews the file while it runs."""
        owner, stop = uuid.uuid4().hex, threading.Event()
        with self._refused():
            self._take(owner, tell)
        keeper = threading.Thread(target=self._keep, args=(owner, stop), daemon=True)
        keeper.start()
        try:
            yield
        finally:
            stop.set()
            keeper.join()
            with contextlib.suppress(OSError):
                if not self._lost:
                    self.remove(LOCK)

    def _take(self, owner: str, tell: Tell) -> None:
        seen, since, told = None, time.monotonic(), False
        while True:
            with self.faults(), contextlib.suppress(self._obstore.exceptions.AlreadyExistsError):
                self._obstore.put(self._store, LOCK, _beat(owner, 0), mode="create")
                return
            now = self.read(LOCK)
            if seen is not None and now is not None and now != seen:
                raise _held(self.shown)
            if time.monotonic() - since > _ABANDONED:
                self.write(LOCK, _beat(owner, 0))
                return
            if not told:
                tell(
                    f"another run has locked {self.shown}; waiting up to {_ABANDONED:.0f} s to see"
                    " whether it still runs"
                )
            seen, told = now, True
            time.sleep(min(1.0, _ABANDONED / 4))

    def _keep(self, owner: str, stop: threading.Event) -> None:
        count = 0
        while not stop.wait(_BEAT):
            count += 1
            with contextlib.suppress(OSError):
                held = json.loads(self.read(LOCK) or b"{}").get("owner", owner)
                self._lost = held != owner
                if self._lost:
                    return
                self.write(LOCK, _beat(owner, count))


Place = Directory | Objects
"""The files of one store; both classes have the same methods."""


def _beat(owner: str, count: int) -> bytes:
    return json.dumps({"owner": owner, "beat": count}).encode()


def _held(shown: str) -> InputError:
    return InputError(
        f"{shown} is being written by another run; wait for it, or give another with"
        f" {option('out')}"
    )


def _reason(error: Exception) -> str:
    """Return the message of the server, or the first line of obstore's message."""
    said = re.search(r"<Message>(.*?)</Message>", str(error), re.DOTALL)
    if said:
        return said.group(1)
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:300]
