"""Command line as ``python -m flexarm``, for environments without the script on the path."""

from flexarm.cli.main import main

if __name__ == "__main__":
    main()
