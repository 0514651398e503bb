"""``python -m gridfold``: the command, where its folder is not on the path."""

from gridfold.cli import main

if __name__ == "__main__":
    main()
