# SPDX-License-Identifier: Apache-2.0
"""Reference tracer for skew systems: textbook formulas in plain Python, slow and with no line of the C++ tracer.

Reads systems and rays (tests/optics/rays/skew_test.cpp writes them), mm; prints a line a ray: place, direction and
optical path on the last surface, or "lost".

  system COUNT                 surfaces follow, the first is the one that the ray meets first
  surface RX KX RY KY A4 A6 A8 A10 DX DY Z TX TY TZ
  medium N Z1 Z2 Z3 Z4 R2 R4 R6      COUNT + 1 of them, the first before the first surface; its frame is that of the
                               surface before it
  ray X Y Z DX DY DZ
"""

import cmath
import math
import sys

STEP = 1e-30  # of complex-step derivatives: f'(x) = Im f(x + i h) / h, without cancellation


def times(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def apply(a, v):
    return [sum(a[i][k] * v[k] for k in range(3)) for i in range(3)]


def transposed(a):
    return [list(row) for row in zip(*a)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def rotation(tx, ty, tz):
    """About x, then the new y, then the new z: Rx Ry Rz, right-handed."""
    cx, sx, cy, sy, cz, sz = math.cos(tx), math.sin(tx), math.cos(ty), math.sin(ty), math.cos(tz), math.sin(tz)
    about_x = [[1, 0, 0], [0, cx, -sx], [0, sx, cx]]
    about_y = [[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]
    about_z = [[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]
    return times(times(about_x, about_y), about_z)


class Lost(Exception):
    pass


class Surface:
    def __init__(self, numbers):
        self.rx, self.kx, self.ry, self.ky = numbers[0:4]
        self.a = numbers[4:8]
        self.origin = numbers[8:11]
        self.axes = rotation(*numbers[11:14])

    def inside(self, p):
        return apply(transposed(self.axes), [p[i] - self.origin[i] for i in range(3)])

    def outside(self, p):
        q = apply(self.axes, p)
        return [q[i] + self.origin[i] for i in range(3)]

    def sag(self, x, y):
        cx, cy = 1 / self.rx, 1 / self.ry
        under = 1 - (1 + self.kx) * (cx * x) ** 2 - (1 + self.ky) * (cy * y) ** 2
        if isinstance(under, complex):
            root = cmath.sqrt(under)
        elif under < 0:
            raise Lost
        else:
            root = math.sqrt(under)
        r2 = x * x + y * y
        return (cx * x * x + cy * y * y) / (1 + root) + sum(a * r2 ** (i + 2) for i, a in enumerate(self.a))

    def slopes(self, x, y):
        return self.sag(x + 1j * STEP, y).imag / STEP, self.sag(x, y + 1j * STEP).imag / STEP

    def normal(self, x, y):
        sx, sy = self.slopes(x, y)
        length = math.sqrt(1 + sx * sx + sy * sy)
        return [-sx / length, -sy / length, 1 / length]

    def meet(self, p, d):
        """Distance along the unit direction from p to the surface, in its frame; tried from the vertex plane first, then
        from places around it, as a steep surface may not reach there."""
        plane = -p[2] / d[2]
        try:
            return self.newton(p, d, plane)
        except Lost:
            found = []
        for k in range(-60, 61):
            try:
                found.append(self.newton(p, d, plane + 0.1 * k))
            except Lost:
                pass
        if not found:
            raise Lost
        return min(found, key=lambda s: abs(s - plane))

    def newton(self, p, d, s):
        for _ in range(60):
            x, y = p[0] + s * d[0], p[1] + s * d[1]
            height = p[2] + s * d[2] - self.sag(x, y)
            sx, sy = self.slopes(x, y)
            move = height / (d[2] - sx * d[0] - sy * d[1])
            s -= move
            if abs(move) < 1e-13:
                return s
        raise Lost


class Medium:
    def __init__(self, numbers, frame):
        self.n = numbers[0]
        self.along = numbers[1:5]
        self.across = numbers[5:8]
        self.frame = frame
        self.graded = any(numbers[1:])

    def local(self, x, y, z):
        r2 = x * x + y * y
        return (self.n + sum(a * z ** (i + 1) for i, a in enumerate(self.along)) +
                sum(a * r2 ** (i + 1) for i, a in enumerate(self.across)))

    def at(self, p):
        return self.local(*self.frame.inside(p)) if self.graded else self.n

    def rates(self, z, state):
        """Hamilton's equations with z as the parameter: optical direction cosines p and q."""
        x, y, p, q, _ = state
        n = self.local(x, y, z)
        nx = self.local(x + 1j * STEP, y, z).imag / STEP
        ny = self.local(x, y + 1j * STEP, z).imag / STEP
        along = math.sqrt(n * n - p * p - q * q)
        return [p / along, q / along, n * nx / along, n * ny / along, n * n / along]

    def step(self, z, state, h):
        a = self.rates(z, state)
        b = self.rates(z + h / 2, [s + h / 2 * r for s, r in zip(state, a)])
        c = self.rates(z + h / 2, [s + h / 2 * r for s, r in zip(state, b)])
        d = self.rates(z + h, [s + h * r for s, r in zip(state, c)])
        return [s + h / 6 * (i + 2 * j + 2 * k + m) for s, i, j, k, m in zip(state, a, b, c, d)]

    def follow(self, p, d, target):
        """Along the curve to the target surface: place, direction, optical path."""
        local, way = self.frame.inside(p), apply(transposed(self.frame.axes), d)
        n = self.local(*local)
        state, z = [local[0], local[1], n * way[0], n * way[1], 0.0], local[2]

        def over(z, state):
            at = target.inside(self.frame.outside([state[0], state[1], z]))
            return at[2] - target.sag(at[0], at[1])

        h = 0.02
        before = over(z, state)
        if before > 1e-12:
            raise Lost
        for _ in range(2000):
            after = self.step(z, state, h)
            if over(z + h, after) >= 0:
                break
            z, state = z + h, after
        else:
            raise Lost
        low, high = 0.0, h
        f_low, f_high = over(z, state), over(z + h, after)
        for _ in range(100):  # regula falsi of Illinois
            middle = (low * f_high - high * f_low) / (f_high - f_low)
            f = over(z + middle, self.step(z, state, middle))
            if abs(f) < 1e-15 or high - low < 1e-14:
                break
            if f * f_high < 0:
                low, f_low = high, f_high
            else:
                f_low /= 2
            high, f_high = middle, f
        state, z = self.step(z, state, middle), z + middle
        n = self.local(state[0], state[1], z)
        along = math.sqrt(n * n - state[2] ** 2 - state[3] ** 2)
        return (self.frame.outside([state[0], state[1], z]),
                apply(self.frame.axes, [state[2] / n, state[3] / n, along / n]), state[4])


def refracted(d, normal, before, behind):
    """n (N x d) is the same on both sides (Hecht, Optics, 4.4)."""
    if dot(d, normal) < 0:
        normal = [-x for x in normal]
    tangent = [before / behind * x for x in cross(normal, d)]
    rest = 1 - dot(tangent, tangent)
    if rest < 0:
        raise Lost
    back = cross(tangent, normal)
    return [back[i] + math.sqrt(rest) * normal[i] for i in range(3)]


def trace(surfaces, media, p, d):
    path = 0.0
    for surface, before, behind in zip(surfaces, media, media[1:]):
        if before.graded:
            p, d, length = before.follow(p, d, surface)
        else:
            s = surface.meet(surface.inside(p), apply(transposed(surface.axes), d))
            if s < -1e-9:
                raise Lost
            p = [p[i] + s * d[i] for i in range(3)]
            length = before.n * s
        path += length
        at = surface.inside(p)
        normal = apply(surface.axes, surface.normal(at[0], at[1]))
        d = refracted(d, normal, before.at(p), behind.at(p))
    return p + d + [path]


def main():
    surfaces, rows = [], []
    for line in sys.stdin:
        kind, *numbers = line.split()
        numbers = [float(x) for x in numbers]
        if kind == "system":
            surfaces, rows = [], []
        elif kind == "surface":
            surfaces.append(Surface(numbers))
        elif kind == "medium":
            rows.append(numbers)
        elif kind == "ray":
            media = [Medium(row, surfaces[max(i - 1, 0)]) for i, row in enumerate(rows)]
            try:
                print(" ".join(repr(x) for x in trace(surfaces, media, numbers[:3], numbers[3:])))
            except (Lost, ZeroDivisionError, OverflowError, ValueError):
                print("lost")


main()
