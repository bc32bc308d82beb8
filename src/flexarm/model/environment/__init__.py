"""Description of the environment of an arm: contacts and loads."""
