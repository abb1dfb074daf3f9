"""``python -m annik_training.cli``."""

from annik_training.cli import main

if __name__ == "__main__":
    main()
