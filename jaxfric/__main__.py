"""`python -m jaxfric` is the command `jaxfric`."""

from .cli import main

if __name__ == "__main__":
    main()
