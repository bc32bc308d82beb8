"""Arms for simulators of rigid bodies: links as chains of bars on springs."""
