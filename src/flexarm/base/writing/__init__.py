"""Writing of files: paths checked in advance, files written completely or not at all."""
