"""Plans of whole tasks: optimal motions, learning of repeated motions, proposed controllers."""
