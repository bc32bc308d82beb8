"""Cases in files: scenarios, studies of many samples, and files of results."""
