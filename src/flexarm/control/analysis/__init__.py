"""Linear analysis of sampled loops: poles, responses, margins."""
