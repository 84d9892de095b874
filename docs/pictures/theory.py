#!/usr/bin/env python3
"""Draws the figures of docs/theory.md, as SVG beside this file: python3 docs/pictures/theory.py"""

import math
import pathlib

INK, SOFT, TISSUE, PROBE, FINGER, SKIN = "#222", "#888", "#f4dcd2", "#b9c4d0", "#7a94ad", "#d98b3a"


class Picture:
    def __init__(self, width, height, title):
        self.parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
            f'font-family="sans-serif" font-size="13" role="img"><title>{title}</title>',
            '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
            f'orient="auto-start-reverse"><path d="M0 0L8 4L0 8z" fill="{INK}"/></marker></defs>',
            f'<rect width="{width}" height="{height}" fill="#fff"/>']

    def line(self, x0, y0, x1, y1, colour=INK, width=1.0, more=""):
        self.parts.append(f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{colour}" '
                          f'stroke-width="{width}" {more}/>')

    def arrow(self, x0, y0, x1, y1, both=False):
        ends = 'marker-end="url(#tip)"' + (' marker-start="url(#tip)"' if both else "")
        self.line(x0, y0, x1, y1, INK, 1.3, ends)

    def shape(self, points, fill, colour=INK, opacity=1.0):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.parts.append(f'<polygon points="{path}" fill="{fill}" stroke="{colour}" fill-opacity="{opacity}"/>')

    def box(self, x, y, width, height, fill, colour=INK):
        self.shape([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], fill, colour)

    def curve(self, points, colour=INK, width=1.5):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width}"/>')

    def dot(self, x, y, radius=3.0, fill=INK):
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{fill}" stroke="{INK}"/>')

    def text(self, x, y, words, anchor="middle", colour=INK):
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{words}</text>')

    def held(self, x0, x1, y):
        """A fixed edge."""
        self.line(x0, y, x1, y, INK, 2)
        for x in range(int(x0) + 8, int(x1) + 1, 12):
            self.line(x, y, x - 8, y + 8, SOFT)

    def save(self, name):
        (pathlib.Path(__file__).parent / name).write_text("\n".join([*self.parts, "</svg>"]) + "\n")


def columns(begin, end, finest, coarsest, growth):
    """From the end that is fine to the other, inside [begin, end] or [end, begin]."""
    way, step, at = math.copysign(1, end - begin), finest, begin
    while (end - at) * way > step:
        at += way * step
        yield at
        step = min(step * growth, coarsest)


def window():
    p = Picture(720, 270, "The tissue that a window is touched on")
    scale, top, depth = 2.4, 70, 96  # pixels per mm; 40 mm deep
    left, begin = 48, 48 + 100 * scale
    end, right = begin + 60 * scale, begin + 160 * scale
    p.box(left, top, right - left, depth, TISSUE)
    for x in [begin + 3 * scale * i for i in range(21)]:
        p.line(x, top, x, top + depth, SOFT, 0.6)
    for x in [*columns(begin, left, 8, 19, 1.3), *columns(end, right, 8, 19, 1.3)]:
        p.line(x, top, x, top + depth, SOFT, 0.6)
    for y in [top + 7 * j for j in range(1, 8)] + [top + 49 + 11 * j for j in range(1, 5)]:
        p.line(left, y, right, y, SOFT, 0.6)
    p.held(left, right, top + depth)
    p.box(begin, top - 26, end - begin, 26, PROBE)
    p.text((begin + end) / 2, top - 9, "probe")
    p.arrow(left - 26, top, left - 26, top + 60)
    p.text(left - 36, top + 62, "y", "end")
    p.arrow(left - 26, top, left + 34, top)
    p.text(left + 36, top - 8, "x")
    for x0, x1, words in ((left, begin, "context, up to 100 mm"), (begin, end, "window, 60 mm"),
                          (end, right, "context, up to 100 mm")):
        p.arrow(x0 + 2, top + depth + 28, x1 - 2, top + depth + 28, both=True)
        p.text((x0 + x1) / 2, top + depth + 46, words)
    p.text((left + right) / 2, top + depth + 78, "fine columns under the finger, coarser ones beside; the bottom is held, "
           "other edges are free", colour="#555")
    p.save("theory-window.svg")


def contact():
    p = Picture(720, 330, "A rounded tip on a row of nodes")
    surface, middle, radius, depth = 190, 290, 190, 46  # the tip's radius and its indentation, in pixels
    left, right, reach = 30, 550, math.sqrt(2 * radius * depth)

    def overlap(x):
        return depth - (x - middle) ** 2 / (2 * radius)

    tip = [(x, surface + overlap(x)) for x in range(middle - 190, middle + 191, 2)]
    p.shape([(left, surface), (right, surface), (right, 290), (left, 290)], TISSUE, TISSUE)
    p.shape([*tip, (tip[-1][0], 40), (tip[0][0], 40)], FINGER, INK, 0.45)
    p.curve([(x, y + 3) for x, y in tip if abs(x - middle) < reach], SKIN, 5)
    p.line(left, surface, right, surface, INK, 1, 'stroke-dasharray="5 4"')
    for i in range(-6, 7):
        x = middle + 40 * i + 14
        if i not in (0, -1) and abs(x - middle) < reach:
            p.arrow(x, surface + 3, x, surface + overlap(x) - 1)
        p.dot(x, surface, 3, "#fff")
    p.text(middle - 70, surface + 20, "w_i", "start")
    p.arrow(middle, surface, middle, surface + depth, both=True)
    p.text(middle - 6, surface + 29, "d", "end")
    p.text(middle, 62, "tip of radius R, at X")
    p.line(middle + 100, surface + overlap(middle + 100) + 4, middle + 150, surface + 62, SKIN)
    p.text(middle + 154, surface + 70, "skin", "start", SKIN)
    p.text(left, surface - 8, "nodes", "start", "#555")
    x, y = 580, 90
    p.arrow(x, y, x, y + 66)
    p.text(x + 8, y + 70, "normal n, d", "start")
    p.arrow(x, y, x + 66, y)
    p.text(x + 72, y + 5, "lateral", "start")
    p.arrow(x, y, x + 44, y - 34)
    p.text(x + 40, y - 42, "second lateral")
    p.text(middle, 318, "gaps w_i are prescribed; the skin between tip and nodes makes U smooth in the pose", colour="#555")
    p.save("theory-contact.svg")


def solid():
    p = Picture(720, 360, "A solid block and its slices")

    def at(x, y, z):  # drawn obliquely: x to the right, y down, z to the back
        return 70 + x + 0.55 * z, 140 + y - 0.4 * z

    width, depth, across, pad = 380, 130, 220, 60

    def face(points, fill, colour=INK, opacity=1.0):
        p.shape([at(*q) for q in points], fill, colour, opacity)

    w, h, l = width, depth, across
    face([(0, 0, 0), (w, 0, 0), (w, 0, l), (0, 0, l)], "#fbf1ec", SOFT)
    face([(0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0)], "#fbf1ec", SOFT)
    face([(w, 0, 0), (w, 0, l), (w, h, l), (w, h, 0)], "#f3e4dc", SOFT)
    face([(pad, 0, pad), (w - pad, 0, pad), (w - pad, 0, l - pad), (pad, 0, l - pad)], TISSUE)
    for z in (l - pad, l / 2, pad):
        face([(pad, 0, z), (w - pad, 0, z), (w - pad, h, z), (pad, h, z)], PROBE, INK, 0.55)
    for y in (22, 48, 84):
        p.line(*at(0, y, 0), *at(w, y, 0), SOFT, 0.7)
        p.line(*at(w, y, 0), *at(w, y, l), SOFT, 0.7)
    x0, y0 = at(0, h, 0)
    p.held(x0, x0 + w, y0)
    x, y = at(0, 0, 0)
    p.arrow(x - 24, y, x + 36, y)
    p.text(x + 30, y - 7, "x")
    p.arrow(x - 24, y, x - 24, y + 60)
    p.text(x - 36, y + 60, "y")
    p.arrow(x - 24, y, x - 24 + 44, y - 32)
    p.text(x + 14, y - 40, "z")
    fx, fy = at(w / 2 - 10, 0, l / 2 + 30)
    p.parts.append(f'<ellipse cx="{fx:.1f}" cy="{fy - 17:.1f}" rx="20" ry="22" fill="{FINGER}" stroke="{INK}"/>')
    p.text(fx, fy - 46, "finger")
    for z, words in ((pad, "slice at z_1"), (l / 2, "z_2"), (l - pad, "z_3")):
        sx, sy = at(w - pad, 70, z)
        p.line(sx, sy, 590, 262 - 0.42 * z * 1.1, SOFT, 0.8)
        p.text(595, 266 - 0.42 * z * 1.1, words, "start")
    p.line(*at(pad / 2, 0, l / 2), 120, 40, SOFT, 0.8)
    p.text(16, 32, "tissue around it: the block is periodic", "start")
    p.text(360, 318, "rows of nodes are layers, graded along y; between slices ln E is interpolated; the bottom is held",
           colour="#555")
    p.save("theory-solid.svg")


if __name__ == "__main__":
    window()
    contact()
    solid()
