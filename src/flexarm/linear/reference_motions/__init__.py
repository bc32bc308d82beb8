"""References of the bent arm: quasi-static, and pressing on a surface."""
