"""Pixel shading: each surface of a pixel is shaded once and weighted by the samples it covers.

Filtered textures (trilinear, anisotropic), relief from brightness, Lambert with wrapped light for skin, GGX highlights (Walter
2007), two lights with soft shadows, hemisphere ambience, a filmic curve (Narkowicz 2015) and slight vignetting.
"""

from __future__ import annotations

import numba
import numpy as np

from afford.render.shadows import lamp_visibility

F = np.float32
DISPLAY = (np.linspace(0, 1, 4096) ** (2 / 2.2)).astype(np.float32)
"""display encoding of a square root"""


@numba.njit(cache=True, fastmath=True, inline="always")
def _texel(texels, offset, h, w, u, v):  # type: ignore[no-untyped-def]  # numba infers
    """Interpolate a texel of one level at (u, v) in texels, wrapped; linear RGB."""
    left, top = np.floor(u), np.floor(v)
    s, t = u - left, v - top
    j, i = int(left), int(top)
    j0, i0 = j & (w - 1), i & (h - 1)
    j1, i1 = (j + 1) & (w - 1), (i + 1) & (h - 1)
    a, b, c, d = offset + i0 * w + j0, offset + i0 * w + j1, offset + i1 * w + j0, offset + i1 * w + j1
    wa, wb, wc, wd = (F(1) - s) * (F(1) - t), s * (F(1) - t), (F(1) - s) * t, s * t
    red = F(texels[a, 0]) * wa + F(texels[b, 0]) * wb + F(texels[c, 0]) * wc + F(texels[d, 0]) * wd
    green = F(texels[a, 1]) * wa + F(texels[b, 1]) * wb + F(texels[c, 1]) * wc + F(texels[d, 1]) * wd
    blue = F(texels[a, 2]) * wa + F(texels[b, 2]) * wb + F(texels[c, 2]) * wc + F(texels[d, 2]) * wd
    return red * red, green * green, blue * blue


@numba.njit(cache=True, fastmath=True, inline="always")
def sample(texels, levels, layer, u, v, ux, vx, uy, vy):  # type: ignore[no-untyped-def]
    """Sample filtered linear RGB at uv, given the change of uv between pixels along x and y."""
    h, w = F(levels[layer, 0, 1]), F(levels[layer, 0, 2])
    long_u, long_v = ux * w, vx * h
    short, long = (uy * w) ** 2 + (vy * h) ** 2, long_u**2 + long_v**2
    if short > long:
        long_u, long_v, long, short = uy * w, vy * h, short, long
    long = np.sqrt(long)
    taps = min(max(np.int32(np.ceil(long / np.sqrt(max(short, F(1))) - F(0.4))), np.int32(1)), np.int32(6))
    share = F(1) / F(taps)
    lod = max(np.log2(max(long * share, F(1e-6))), F(0))
    long_u, long_v = long_u / w, long_v / h
    low = min(int(lod), levels.shape[1] - 1)
    high = min(low + 1, levels.shape[1] - 1)
    part = min(max(F(2) * (lod - np.floor(lod)) - F(0.5), F(0)), F(1))
    low, part = (high, F(0)) if part >= F(1) else (low, part)
    r, g, b = F(0), F(0), F(0)
    for k in range(taps):
        along = (F(k) + F(0.5)) * share - F(0.5)
        x, y = u + along * long_u, v + along * long_v
        for which in range(2 if part > 0 and high > low else 1):
            level = low if which == 0 else high
            start, tall, wide = levels[layer, level, 0], levels[layer, level, 1], levels[layer, level, 2]
            p, q, s = _texel(texels, start, tall, wide, x * F(wide) - F(0.5), y * F(tall) - F(0.5))
            weight = F(1) if high == low or part == 0 else (F(1) - part if which == 0 else part)
            r, g, b = r + p * weight, g + q * weight, b + s * weight
    share *= F(1 / 65025)
    return r * share, g * share, b * share


@numba.njit(cache=True, fastmath=True)
def _film(x):  # type: ignore[no-untyped-def]
    """Apply the filmic tone curve and the display encoding, 0..1."""
    x = max(x, F(0)) * F(0.75)
    y = (x * (F(2.51) * x + F(0.03))) / (x * (F(2.43) * x + F(0.59)) + F(0.14))
    return DISPLAY[int(np.sqrt(min(y, F(1))) * F(len(DISPLAY) - 1) + F(0.5))]


@numba.njit(cache=True, fastmath=True)
def shade(want, supersample, E, seen, nearness, geometry, looks, textures, eye, lamps, maps, ambience, vignette, out):  # type: ignore[no-untyped-def]
    """Shade the pixels in `want` (h, w) bool of `out` (h, w, 3) uint8."""
    height, width = want.shape
    count = supersample * supersample
    faces, part = np.zeros(count, np.int32), geometry[5]
    for y in range(height):
        for x in range(width):
            if not want[y, x]:
                continue
            r, g, b = F(0), F(0), F(0)
            for k in range(count):
                faces[k] = seen[y * supersample + k // supersample, x * supersample + k % supersample]
            for k in range(count):
                face = faces[k]
                if face < 0:
                    continue
                cover, sx, sy = 0, 0.0, 0.0
                near = nearness[y * supersample + k // supersample, x * supersample + k % supersample]
                for m in range(k, count):
                    if faces[m] < 0 or part[faces[m]] != part[face]:
                        continue
                    other = nearness[y * supersample + m // supersample, x * supersample + m % supersample]
                    if abs(other - near) < F(0.02) * near:
                        cover += 1
                        sx += m % supersample
                        sy += m // supersample
                        faces[m] = -1 if m > k else faces[m]
                px = x + (sx / cover + 0.5) / supersample - 0.5
                py = y + (sy / cover + 0.5) / supersample - 0.5
                p, q, s = _surface(px, py, face, E, geometry, looks, textures, eye, lamps, maps, ambience)
                weight = F(cover) / F(count)
                dim = ambience[2, 0] * _falloff(x, y, width, height, vignette)
                r, g, b = r + _film(p * dim) * weight, g + _film(q * dim) * weight, b + _film(s * dim) * weight
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = r * F(255) + F(0.5), g * F(255) + F(0.5), b * F(255) + F(0.5)


@numba.njit(cache=True, fastmath=True)
def _falloff(x, y, width, height, vignette):  # type: ignore[no-untyped-def]
    u, v = (x - width / 2) / (width / 2), (y - height / 2) / (width / 2)
    return F(1.0 - vignette * (u * u + v * v))


@numba.njit(cache=True, fastmath=True, inline="always")
def _mix(table, i, j, k, axis, a, b, c):  # type: ignore[no-untyped-def]
    """Interpolate one column of a vertex table."""
    return table[i, axis] * a + table[j, axis] * b + table[k, axis] * c


@numba.njit(cache=True, fastmath=True, inline="always")
def _unit(x, y, z):  # type: ignore[no-untyped-def]
    scale = F(1) / max(np.sqrt(x * x + y * y + z * z), F(1e-12))
    return x * scale, y * scale, z * scale


@numba.njit(cache=True, fastmath=True, inline="always")
def _surface(px, py, face, E, geometry, looks, textures, eye, lamps, maps, ambience):  # type: ignore[no-untyped-def]
    """Shade the triangle `face` at image point (px, py); linear RGB."""
    vertices, normals, colours, uv, faces, part, layers = geometry
    texels, levels = textures
    a = E[face, 0, 0] * px + E[face, 0, 1] * py + E[face, 0, 2]
    b = E[face, 1, 0] * px + E[face, 1, 1] * py + E[face, 1, 2]
    c = E[face, 2, 0] * px + E[face, 2, 1] * py + E[face, 2, 2]
    inv = 1.0 / (a + b + c)
    a, b, c = a * inv, b * inv, c * inv
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    p = part[face]
    u, v = _mix(uv, i, j, k, 0, a, b, c), _mix(uv, i, j, k, 1, a, b, c)
    sx, sy = (E[face, 0, 0] + E[face, 1, 0] + E[face, 2, 0]) * inv, (E[face, 0, 1] + E[face, 1, 1] + E[face, 2, 1]) * inv
    ux = _mix(uv, i, j, k, 0, E[face, 0, 0], E[face, 1, 0], E[face, 2, 0]) * inv - u * sx
    uy = _mix(uv, i, j, k, 0, E[face, 0, 1], E[face, 1, 1], E[face, 2, 1]) * inv - u * sy
    vx = _mix(uv, i, j, k, 1, E[face, 0, 0], E[face, 1, 0], E[face, 2, 0]) * inv - v * sx
    vy = _mix(uv, i, j, k, 1, E[face, 0, 1], E[face, 1, 1], E[face, 2, 1]) * inv - v * sy
    red, green, blue = sample(texels, levels, layers[p], F(u), F(v), F(ux), F(vx), F(uy), F(vy))
    a, b, c = F(a), F(b), F(c)
    X, Y, Z = _mix(vertices, i, j, k, 0, a, b, c), _mix(vertices, i, j, k, 1, a, b, c), _mix(vertices, i, j, k, 2, a, b, c)
    nx, ny, nz = _unit(
        _mix(normals, i, j, k, 0, a, b, c), _mix(normals, i, j, k, 1, a, b, c), _mix(normals, i, j, k, 2, a, b, c)
    )
    wx, wy, wz = _unit(eye[0] - X, eye[1] - Y, eye[2] - Z)
    if nx * wx + ny * wy + nz * wz < 0:
        nx, ny, nz = -nx, -ny, -nz
    red = red * looks[p, 0] * _mix(colours, i, j, k, 0, a, b, c)
    green = green * looks[p, 1] * _mix(colours, i, j, k, 1, a, b, c)
    blue = blue * looks[p, 2] * _mix(colours, i, j, k, 2, a, b, c)
    return _light((X, Y, Z), (nx, ny, nz), (wx, wy, wz), (red, green, blue), looks, p, lamps, maps, ambience)


@numba.njit(cache=True, fastmath=True, inline="always")
def _light(P, N, V, albedo, looks, p, lamps, maps, ambience):  # type: ignore[no-untyped-def]
    """Compute reflected light; `lamps` (n, 20): frame (12), direction to the lamp (3), colour (3), softness, texel."""
    specular, metal, skin = looks[p, 3], looks[p, 6], looks[p, 7]
    alpha = max(looks[p, 4] * looks[p, 4], F(0.02))
    nv = max(N[0] * V[0] + N[1] * V[1] + N[2] * V[2], F(0.02))
    mirror = F(2) * nv * N[2] - V[2]
    fringe = specular * (F(1) + metal) + (F(1) - specular) * (F(1) - nv) ** 5 * (F(1) - looks[p, 4])
    up, gleam = F(0.5) + F(0.5) * N[2], _room(F(2) * nv * N[0] - V[0], F(2) * nv * N[1] - V[1], mirror, looks[p, 4])
    dr, dg, db = _sky(ambience, 0, up), _sky(ambience, 1, up), _sky(ambience, 2, up)
    sr, sg, sb = _sky(ambience, 0, gleam) * fringe, _sky(ambience, 1, gleam) * fringe, _sky(ambience, 2, gleam) * fringe
    for n in range(len(lamps)):
        nl = N[0] * lamps[n, 12] + N[1] * lamps[n, 13] + N[2] * lamps[n, 14]
        if nl <= F(-0.4) * skin:
            continue
        seen = _seen(P, N, lamps, n, maps)
        if seen <= 0:
            continue
        straight, wrapped = max(nl, F(0)), max((nl + F(0.4)) / F(1.4), F(0))
        spread = (wrapped - straight) * skin
        dr += lamps[n, 15] * seen * (straight + spread)
        dg += lamps[n, 16] * seen * (straight + spread * F(0.55))
        db += lamps[n, 17] * seen * (straight + spread * F(0.45))
        if straight > 0:
            gloss = _gloss(N, V, lamps, n, straight, nv, alpha, specular) * seen
            sr, sg, sb = sr + lamps[n, 15] * gloss, sg + lamps[n, 16] * gloss, sb + lamps[n, 17] * gloss
    matt = F(1) - metal * F(0.6)
    tint = F(1) - metal
    red, green, blue = albedo
    return (
        red * dr * matt + sr * (tint + red * metal),
        green * dg * matt + sg * (tint + green * metal),
        blue * db * matt + sb * (tint + blue * metal),
    )


@numba.njit(cache=True, fastmath=True, inline="always")
def _room(x, y, z, rough):  # type: ignore[no-untyped-def]
    """Reflected environment: dark table, brighter wall, a window band; blurred by roughness."""
    band = max(F(0), F(1) - abs(z - F(0.45)) * F(2.6)) * (F(0.55) + F(0.45) * np.sin(F(3) * x + F(2) * y))
    return F(0.5) + F(0.5) * z + band * (F(1) - rough) * F(1.3)


@numba.njit(cache=True, fastmath=True, inline="always")
def _sky(ambience, channel, up):  # type: ignore[no-untyped-def]
    return ambience[0, channel] * up + ambience[1, channel] * (F(1) - up)


@numba.njit(cache=True, fastmath=True, inline="always")
def _seen(P, N, lamps, n, maps):  # type: ignore[no-untyped-def]
    """Compute the visible share of a lamp from a point slightly above the surface."""
    qx, qy, qz = P[0] + N[0] * F(0.004), P[1] + N[1] * F(0.004), P[2] + N[2] * F(0.004)
    x = lamps[n, 0] * qx + lamps[n, 1] * qy + lamps[n, 2] * qz + lamps[n, 3]
    y = lamps[n, 4] * qx + lamps[n, 5] * qy + lamps[n, 6] * qz + lamps[n, 7]
    z = lamps[n, 8] * qx + lamps[n, 9] * qy + lamps[n, 10] * qz + lamps[n, 11] - F(0.002)
    return lamp_visibility(maps, n, x, y, z, lamps[n, 18], lamps[n, 19])


@numba.njit(cache=True, fastmath=True, inline="always")
def _gloss(N, V, lamps, n, nl, nv, alpha, specular):  # type: ignore[no-untyped-def]
    """Compute the bounded GGX highlight of one lamp."""
    hx, hy, hz = _unit(lamps[n, 12] + V[0], lamps[n, 13] + V[1], lamps[n, 14] + V[2])
    nh = max(N[0] * hx + N[1] * hy + N[2] * hz, F(0))
    vh = max(V[0] * hx + V[1] * hy + V[2] * hz, F(0))
    d = nh * nh * (alpha * alpha - F(1)) + F(1)
    fresnel = specular + (F(1) - specular) * (F(1) - vh) ** 5
    return min(alpha * alpha / (F(3.14159) * d * d) * fresnel / (F(4) * max(nl * nv, F(0.05))) * nl, F(6))
