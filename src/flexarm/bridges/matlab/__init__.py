"""Linear models, results and the equations of an arm as files of MATLAB and GNU Octave."""
