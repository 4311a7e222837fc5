"""The version of airrace."""

VERSION = "0.1.0"
