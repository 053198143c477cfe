"""`python -m carigs`."""

from carigs.cli.run import main

if __name__ == "__main__":
    main()
