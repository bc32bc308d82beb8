"""Description of an arm: links, sections, joints, damping, and variations of them."""
