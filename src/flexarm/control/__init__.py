"""Controllers: contract, laws, design, filters, analysis of sampled loops, hardware."""
