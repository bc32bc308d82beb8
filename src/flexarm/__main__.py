"""``python -m flexarm``: the command line, where the script is not on the path."""

from flexarm.cli.main import main

if __name__ == "__main__":
    main()
