"""The arm: its constants, dynamics, observables and actions; ``Arm`` is its public object."""
