"""The version number of jaxfric that files and pages state."""


def installed_version() -> str:
    """The version number of this jaxfric."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("jaxfric")
    except PackageNotFoundError:  # jaxfric runs from a source tree
        return "(not installed)"
