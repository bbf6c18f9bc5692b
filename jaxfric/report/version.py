"""The number of this jaxfric, as files and pages bear it."""


def installed_version() -> str:
    """The number of this jaxfric."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("jaxfric")
    except PackageNotFoundError:  # run from a source tree
        return "(not installed)"
