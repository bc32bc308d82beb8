"""Labels of lines are inside the axes, beside their own line, without overlap."""

from __future__ import annotations

import numpy as np
from gallery.line_labels import label_lines
from matplotlib.figure import Figure


def test_labels_are_beside_their_lines_without_overlap() -> None:
    figure = Figure(figsize=(4.0, 3.0), layout="constrained")
    axes = figure.subplots()
    x = np.linspace(0.0, 1.0, 200)
    for power in (1, 2, 3):
        axes.plot(x, x**power, color=f"C{power}", label=f"power {power}")
    axes.plot([0.1, 0.5, 0.9], [0.9, 0.85, 0.8], "o", color="C5", label="dots")
    texts = label_lines(axes)

    assert [text.get_text() for text in texts] == ["power 1", "power 2", "power 3", "dots"]
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in texts]
    inner = axes.get_window_extent()
    for k, (box, line) in enumerate(zip(boxes, axes.get_lines(), strict=True)):
        assert texts[k].get_color() == line.get_color()
        assert inner.x0 <= box.x0
        assert box.x1 <= inner.x1
        assert inner.y0 <= box.y0
        assert box.y1 <= inner.y1
        assert not any(box.overlaps(other) for other in boxes[:k])
        near = []
        for each in axes.get_lines():
            points = axes.transData.transform(each.get_xydata())
            beside = np.maximum(box.min - points, points - box.max)
            near.append(np.hypot(*np.maximum(beside, 0.0).T).min())
        assert min(near) > 0.0, "a label covers a line"
        assert np.argmin(near) == k, "a label is nearer to another line"
        assert near[k] < 10.0
