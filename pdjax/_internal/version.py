"""The version of pdjax."""

VERSION = "0.1.0"
