"""Public plots and their modules; `__init__.py` loads each when it is first used."""

from .bodies import bending_moment as bending_moment
from .bodies import deflection as deflection
from .bodies import postures as postures
from .comparison import comparison_figure as comparison_figure
from .comparison import samples as samples
from .comparison import samples_figure as samples_figure
from .comparison import study as study
from .histories import compare as compare
from .histories import history as history
from .histories import phase_portrait as phase_portrait
from .histories import signals_figure as signals_figure
from .style import styled as styled
from .vibration import bode as bode
from .vibration import campbell as campbell
from .vibration import modes as modes
from .vibration import modes_figure as modes_figure
from .vibration import response_figure as response_figure
from .vibration import tracks_figure as tracks_figure
