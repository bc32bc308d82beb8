"""Changes that no test can notice, each with its reason; the sample leaves them out.

By file name: the line before and after the change, and why both programs do the same.
"""

_ONE_DIMENSION = "an array of one dimension: its first size is its last"

_REPLACED = "replaced at the first chord, except for a point that is NaN, which no surface is near"

_ENOUGH = "two or three passes are usual, and a step that needs dozens does not converge"

_DAMPING = (
    "damping = np.where(np.abs(damping) {} _NONE * np.max(np.abs(damping), initial=0.0), "
    "damping, 0.0)"
)

_PROGRESS = (
    'print(f"evaluation {{evaluation}}: {{squares:.6g}}; fit {{text}}", file=sys.stderr, flush={})'
)

_POLES = "poles = np.where(np.abs(poles) {} _ROUNDING * np.abs(poles).max(initial=0.0), poles, 0.0)"

EQUIVALENT: dict[str, dict[tuple[str, str], str]] = {
    "surface.py": {
        (
            "place = real(knots[near, 0])",
            "place = real(knots[near, -1])",
        ): _REPLACED,
        (
            "place = real(knots[near, 0])",
            "place = real(knots[near, 1])",
        ): _REPLACED,
        (
            "while near < last and real(s) >= real(knots[near + 1, 0]):",
            "while near < last and real(s) > real(knots[near + 1, 0]):",
        ): "at a knot both pieces of the spline have the same point, tangent and curvature",
    },
    "modal.py": {
        (
            _DAMPING.format(">"),
            _DAMPING.format(">="),
        ): "only a zero is equal to the limit, in an arm without damping",
    },
    "linearize.py": {
        (
            _POLES.format(">"),
            _POLES.format(">="),
        ): "only a zero is equal to the limit, if all poles are zero",
    },
    "newmark.py": {
        (
            "_PASSES, _USUAL = 50, 3",
            "_PASSES, _USUAL = 49, 3",
        ): _ENOUGH,
        (
            "_PASSES, _USUAL = 50, 3",
            "_PASSES, _USUAL = 51, 3",
        ): _ENOUGH,
        (
            "break",
            "continue",
        ): "at the end of a run the other passes of the loop do nothing",
        (
            "if old_h > 0.0:",
            "if old_h >= 0.0:",
        ): "before the first span the difference that the ratio multiplies is zero",
    },
    "plant.py": {
        (
            "span = settings, self.duration, np.zeros(0), self.sample_time",
            "span = settings, self.duration, np.zeros( 1), self.sample_time",
        ): "the samples of such a run are not read",
    },
    "closed_lanes.py": {
        (
            "runs.until[:] = np.where(self.alive, until, -1.0)",
            "runs.until[:] = np.where(self.alive, until, 1.0)",
        ): "a run that has failed is repeated alone; what lanes compute after that is not read",
        (
            "rows = rows if self.together else int(self.rows[0])",
            "rows = rows if self.together else int(self.rows[ -1])",
        ): "there is one row",
        (
            "hardware = self._loops[0].hardware",
            "hardware = self._loops[ -1].hardware",
        ): "only the seeds of their hardware differ",
    },
    "execution.py": {
        (
            "threads=1,",
            "threads= 2,",
        ): "results do not depend on the number of threads",
    },
    "response.py": {
        (
            "spectra = _Spectra(parts[0].frequency_hz, np.asarray(total), averages)",
            "spectra = _Spectra(parts[ -1].frequency_hz, np.asarray(total), averages)",
        ): "all records have the same rate, and their segments the same length",
    },
    "identify.py": {
        (
            _PROGRESS.format("True"),
            _PROGRESS.format("False"),
        ): "every line of the standard error is written at once",
    },
    "transcription.py": {
        (
            "curve=(curve * s.curve).reshape(self.intervals, STAGES, -1),",
            "curve=(curve * s.curve).reshape(self.intervals, STAGES, - 2),",
        ): "for NumPy any negative length is the unknown one",
    },
    "changes.py": {
        (
            "inner = np.unique(times[(times > 0.0) & (times < last)])",
            "inner = np.unique(times[(times > 0.0) & (times <= last)])",
        ): "an interval of no length has the value of the next one and is left out",
    },
    "point_motion.py": {
        (
            "for k in range(stations.body.shape[0]):",
            "for k in range(stations.body.shape[ -1]):",
        ): _ONE_DIMENSION,
    },
}
