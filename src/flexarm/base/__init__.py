"""What every wing uses: errors, converters of arguments, user functions, processes, files."""
