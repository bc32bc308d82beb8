"""Description of scenarios and studies: motions, prescribed joints, events, runs."""
