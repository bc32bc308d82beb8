"""Forces on the bodies: loads, contacts, and passive torques of the joints."""
