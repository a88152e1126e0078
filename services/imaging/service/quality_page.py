"""The quality report as one HTML page with its pictures inside: nothing to install, nothing to fetch."""

import base64
from collections.abc import Sequence
from html import escape

import cv2
import numpy as np

from services.imaging.core.tuning import QUALITY_CONTROL, QUALITY_PAGE
from services.imaging.service.quality_report import Measured
from shared.geometry.calibration import NOT_OF_THE_RING
from shared.geometry.parts import RingPart
from shared.messages.qa import QaReport

_GOOD, _BAD, _INK, _FAINT = "#1b7f4b", "#c2321f", "#1d2733", "#9aa7b4"
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;color:#1d2733;max-width:1080px;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
    "th,td{padding:.15em .8em;border-bottom:1px solid #dde3e8;text-align:right}"
    "th:first-child,td:first-child{text-align:left}tr.bad td{color:#c2321f;font-weight:600}"
    "figure{display:inline-block;margin:.5em 1em .5em 0;vertical-align:top}figcaption{max-width:480px;color:#556270}"
    ".good{color:#1b7f4b}.attention{color:#c2321f}details{margin:1em 0}"
)


def html_page(report: QaReport, measured: Sequence[Measured], ring: RingPart) -> str:
    """The page.

    Parameters
    ----------
    report
        What is shown.
    measured
        The accepted images.
    ring
        Where its balls are.
    """
    parts = [
        f"<h1>Ring and C-arm: <span class={report.verdict}>{report.verdict}</span></h1>",
        _origin(report, len(measured)),
        _list(report.findings),
        _drift(report),
        _figure(
            ball_map(report, ring),
            f"Middle residual of each ball in the ring's frame, {QUALITY_PAGE.enlargement:g} times enlarged",
        ),
    ]
    if measured:
        parts.append(_figure(distortion_map(measured[0]), f"Distortion of {measured[0].image.name}, true to scale"))
    parts += [_images(report), _pictures(measured), _balls(report)]
    head = f"<meta charset=utf-8><title>distalock qa</title><style>{_STYLE}</style>"
    return f"<!doctype html><html lang=en><head>{head}</head><body>{''.join(parts)}</body></html>\n"


def _origin(report: QaReport, accepted: int) -> str:
    return (
        f"<p>{accepted} of {len(report.images)} images accepted; made {escape(report.made_at)} by distalock "
        f"{escape(report.software_version)}; ring file {report.ring_sha256[:12]}. Research software, not a medical "
        "device.</p>"
    )


def _list(findings: Sequence[str]) -> str:
    if not findings:
        return "<p class=good>Nothing to look at.</p>"
    return "<ul>" + "".join(f"<li>{escape(f)}</li>" for f in findings) + "</ul>"


def _drift(report: QaReport) -> str:
    if report.drift is None:
        return "<p>No earlier report to compare with.</p>"
    d = report.drift
    x, y, z = d.source_mm
    return (
        f"<p>Since {escape(d.since)}: focal spot moved {x:+.2f}, {y:+.2f}, {z:+.2f} mm; distortion changed by "
        f"{d.distortion_rms_px:.2f} px rms; ball {escape(d.worst_ball)} by {d.worst_ball_mm:.3f} mm, the most.</p>"
    )


def _figure(picture: str, caption: str) -> str:
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"


def ball_map(report: QaReport, ring: RingPart) -> str:
    """SVG of the ring: each ball, and an arrow along its middle residual."""
    reach = float(np.abs(ring.balls.position_mm[:, :2]).max()) + QUALITY_PAGE.beside_ring_mm
    shapes = []
    for ball, (x, y, _) in zip(report.balls, ring.balls.position_mm, strict=True):
        colour = _BAD if ball.flagged else _GOOD
        fill = colour if ball.seen else "none"
        shapes.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="1.6" fill="{fill}" stroke="{colour}" stroke-width=".4"/>')
        tip = x + QUALITY_PAGE.enlargement * ball.shift_x_mm, y + QUALITY_PAGE.enlargement * ball.shift_y_mm
        shapes.append(f'<path d="M{x:.2f} {y:.2f}L{tip[0]:.2f} {tip[1]:.2f}" stroke="{_INK}" stroke-width=".7"/>')
        if ball.flagged:
            shapes.append(
                f'<text x="{x + 2.5:.2f}" y="{y - 2:.2f}" font-size="5" fill="{_BAD}">{escape(ball.id)}</text>'
            )
    bar = QUALITY_PAGE.enlargement * QUALITY_CONTROL.shift_mm
    shapes.append(
        f'<path d="M{-reach + 4:.1f} {reach - 5:.1f}h{bar:.1f}" stroke="{_INK}" stroke-width="1"/>'
        f'<text x="{-reach + 4:.1f}" y="{reach - 8:.1f}" font-size="5">{QUALITY_CONTROL.shift_mm:g} mm (limit)</text>'
    )
    return _svg(shapes, (-reach, -reach, 2.0 * reach, 2.0 * reach))


def distortion_map(one: Measured) -> str:
    """SVG of the image: from measured to ideal pixels, on a grid, faint where it is uncertain."""
    calibration = one.calibration
    last_px = calibration.width_px - 1, calibration.height_px - 1
    x, y = np.meshgrid(*(np.linspace(0, last, QUALITY_PAGE.grid) for last in last_px))
    places = np.column_stack([x.ravel(), y.ravel()])
    if calibration.aperture is not None:
        places = places[calibration.aperture.holds(*places.T)]
    moved = calibration.distortion.displacement_at(places)
    sure = calibration.distortion.standard_deviation_at(places) < QUALITY_PAGE.known_px
    shapes = []
    for (px, py), (dx, dy), known in zip(places, moved, sure, strict=True):
        colour = _INK if known else _FAINT
        shapes.append(
            f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3" fill="{colour}"/>'
            f'<path d="M{px:.1f} {py:.1f}l{dx:.1f} {dy:.1f}" stroke="{colour}" stroke-width="2.5"/>'
        )
    return _svg(shapes, (0.0, 0.0, float(calibration.width_px), float(calibration.height_px)))


def _svg(shapes: Sequence[str], box: tuple[float, float, float, float]) -> str:
    view = " ".join(f"{v:.1f}" for v in box)
    side = QUALITY_PAGE.width_px
    return f'<svg width="{side}" height="{side}" viewBox="{view}">{"".join(shapes)}</svg>'


def _images(report: QaReport) -> str:
    rows = []
    for i in report.images:
        if i.source_mm is None or i.reprojection_rms_px is None or i.distortion_residual_px is None:
            why = escape(i.reasons[0].message) if i.reasons else ""
            rows.append(f'<tr class=bad><td>{escape(i.name)}<td colspan=7 style="text-align:left">{why}</tr>')
            continue
        x, y, z = i.source_mm
        rows.append(
            f"<tr><td>{escape(i.name)}<td>{i.balls_found}<td>{x:.2f}<td>{y:.2f}<td>{z:.2f}"
            f"<td>{i.reprojection_rms_px:.3f}<td>{i.distortion_residual_px:.3f}<td>{i.central_deviation_px:.3f}</tr>"
        )
    head = (
        "<tr><th>image<th>balls<th>focal spot x<th>y<th>z mm<th>residual px<th>left out px<th>middle known to px</tr>"
    )
    return f"<h2>Images</h2><table>{head}{''.join(rows)}</table>"


def _pictures(measured: Sequence[Measured]) -> str:
    figures = [_figure(_thumbnail(one), one.image.name) for one in measured[: QUALITY_PAGE.most_pictures]]
    return f"<details><summary>Pictures</summary>{''.join(figures)}</details>"


def _thumbnail(one: Measured) -> str:
    """The image as received, with rings around the balls that were named."""
    low, high = np.percentile(one.pixels, [QUALITY_PAGE.darkest_percentile, QUALITY_PAGE.brightest_percentile])
    grey = np.clip((one.pixels - low) / max(float(high - low), 1e-6) * 255.0, 0.0, 255.0).astype(np.uint8)
    scale = QUALITY_PAGE.width_px / max(grey.shape)
    picture = cv2.cvtColor(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    balls = one.calibration.balls
    named = balls.ring_index != NOT_OF_THE_RING
    for (x, y), radius in zip(balls.centre_px[named], balls.radius_px[named], strict=True):
        column = one.calibration.width_px - 1 - x if one.calibration.mirrored else x
        centre = (round(float(column) * scale), round(float(y) * scale))
        cv2.circle(picture, centre, max(3, round(scale * float(radius)) + 2), (75, 200, 60), 1, cv2.LINE_AA)
    content = base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode()
    return f'<img alt="" width="{picture.shape[1]}" src="data:image/png;base64,{content}">'


def _balls(report: QaReport) -> str:
    rows = [
        f"<tr{' class=bad' if b.flagged else ''}><td>{escape(b.id)}<td>{b.seen}<td>{b.shift_x_mm:+.4f}"
        f"<td>{b.shift_y_mm:+.4f}<td>{b.rms_mm:.4f}<td>{b.sigmas:.1f}</tr>"
        for b in report.balls
    ]
    head = "<tr><th>ball<th>seen<th>shift x mm<th>shift y mm<th>rms mm<th>standard errors</tr>"
    return f"<h2>Balls</h2><table>{head}{''.join(rows)}</table>"
