"""The network and how it is fitted to examples of any system."""
