"""The rows of the catalogue, one file per kind of device; `drivers/catalogue.py` puts them together."""
