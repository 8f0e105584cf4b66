"""The colour of pixels: each surface seen in a pixel is shaded once and weighted by the samples it covers.

Filtered textures (trilinear, anisotropic), relief from brightness, Lambert with wrapped light for skin, GGX highlights
(Walter 2007), two soft-shadowed lamps, hemisphere ambience, a filmic curve (Narkowicz 2015) and a little vignetting.
"""

from __future__ import annotations

import numba
import numpy as np

from afford.render.shadow import lit

F = np.float32


@numba.njit(cache=True, fastmath=True, inline="always")
def _texel(texels, offset, h, w, u, v):  # type: ignore[no-untyped-def]  # numba infers
    """Bilinear texel of one level at (u, v) in its own texels, wrapped."""
    j, i = int(np.floor(u)), int(np.floor(v))
    s, t = F(u - j), F(v - i)
    j0, i0 = j % w, i % h
    j1, i1 = (j0 + 1) % w, (i0 + 1) % h
    a, b, c, d = offset + i0 * w + j0, offset + i0 * w + j1, offset + i1 * w + j0, offset + i1 * w + j1
    wa, wb, wc, wd = (F(1) - s) * (F(1) - t), s * (F(1) - t), (F(1) - s) * t, s * t
    return (
        texels[a, 0] * wa + texels[b, 0] * wb + texels[c, 0] * wc + texels[d, 0] * wd,
        texels[a, 1] * wa + texels[b, 1] * wb + texels[c, 1] * wc + texels[d, 1] * wd,
        texels[a, 2] * wa + texels[b, 2] * wb + texels[c, 2] * wc + texels[d, 2] * wd,
    )


@numba.njit(cache=True, fastmath=True)
def sample(texels, levels, u, v, ux, vx, uy, vy):  # type: ignore[no-untyped-def]
    """Filtered linear RGB at uv, given the change of uv from one pixel to the next along x and y."""
    h, w = levels[0, 1], levels[0, 2]
    long_u, long_v, short = ux * w, vx * h, np.hypot(uy * w, vy * h)
    long = np.hypot(long_u, long_v)
    if short > long:
        long_u, long_v, long, short = uy * w, vy * h, short, long
    taps = min(max(int(np.ceil(long / max(short, 1.0))), 1), 6)
    lod = max(np.log2(max(long / taps, 1e-6)), 0.0)
    low = min(int(lod), len(levels) - 1)
    high = min(low + 1, len(levels) - 1)
    part = F(lod - int(lod))
    r, g, b = F(0), F(0), F(0)
    for k in range(taps):
        along = (k + 0.5) / taps - 0.5
        x, y = u + along * long_u / w, v + along * long_v / h
        for which in range(2 if part > 0 and high > low else 1):
            level = levels[low] if which == 0 else levels[high]
            p, q, s = _texel(texels, level[0], level[1], level[2], x * level[2] - 0.5, y * level[1] - 0.5)
            weight = F(1) if high == low or part == 0 else (F(1) - part if which == 0 else part)
            r, g, b = r + p * weight, g + q * weight, b + s * weight
    share = F(1.0 / taps)
    return r * share, g * share, b * share


@numba.njit(cache=True, fastmath=True)
def _film(x):  # type: ignore[no-untyped-def]
    """Filmic tone curve, then display encoding, 0..1."""
    x = max(x, F(0)) * F(0.75)
    y = (x * (F(2.51) * x + F(0.03))) / (x * (F(2.43) * x + F(0.59)) + F(0.14))
    return min(max(y, F(0)), F(1)) ** F(1 / 2.2)


@numba.njit(cache=True, fastmath=True)
def shade(want, supersample, E, seen, nearness, geometry, looks, textures, eye, lamps, maps, ambience, vignette, out):  # type: ignore[no-untyped-def]
    """Colour the pixels in `want` (h, w) bool of `out` (h, w, 3) uint8."""
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


@numba.njit(cache=True, fastmath=True)
def _surface(px, py, face, E, geometry, looks, textures, eye, lamps, maps, ambience):  # type: ignore[no-untyped-def]
    """Linear RGB of the triangle `face` seen at image point (px, py)."""
    vertices, normals, colours, uv, faces, part, layers = geometry
    texels, all_levels = textures
    e = E[face]
    a = e[0, 0] * px + e[0, 1] * py + e[0, 2]
    b = e[1, 0] * px + e[1, 1] * py + e[1, 2]
    c = e[2, 0] * px + e[2, 1] * py + e[2, 2]
    inv = 1.0 / (a + b + c)
    a, b, c = a * inv, b * inv, c * inv
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    p = part[face]
    look, levels = looks[p], all_levels[layers[p]]
    P = vertices[i] * F(a) + vertices[j] * F(b) + vertices[k] * F(c)
    N = normals[i] * F(a) + normals[j] * F(b) + normals[k] * F(c)
    dye = colours[i] * F(a) + colours[j] * F(b) + colours[k] * F(c)
    u = uv[i, 0] * a + uv[j, 0] * b + uv[k, 0] * c
    v = uv[i, 1] * a + uv[j, 1] * b + uv[k, 1] * c
    sx, sy = (e[0, 0] + e[1, 0] + e[2, 0]) * inv, (e[0, 1] + e[1, 1] + e[2, 1]) * inv
    ux = (e[0, 0] * uv[i, 0] + e[1, 0] * uv[j, 0] + e[2, 0] * uv[k, 0]) * inv - u * sx
    uy = (e[0, 1] * uv[i, 0] + e[1, 1] * uv[j, 0] + e[2, 1] * uv[k, 0]) * inv - u * sy
    vx = (e[0, 0] * uv[i, 1] + e[1, 0] * uv[j, 1] + e[2, 0] * uv[k, 1]) * inv - v * sx
    vy = (e[0, 1] * uv[i, 1] + e[1, 1] * uv[j, 1] + e[2, 1] * uv[k, 1]) * inv - v * sy
    red, green, blue = sample(texels, levels, u, v, ux, vx, uy, vy)
    V = eye - P
    V /= np.sqrt((V * V).sum())
    N /= max(np.sqrt((N * N).sum()), F(1e-12))
    if (N * V).sum() < 0:
        N = -N
    albedo = np.array([red * dye[0] * look[0], green * dye[1] * look[1], blue * dye[2] * look[2]], np.float32)
    return _light(P, N, V, albedo, look, lamps, maps, ambience)


@numba.njit(cache=True, fastmath=True)
def _light(P, N, V, albedo, look, lamps, maps, ambience):  # type: ignore[no-untyped-def]
    """Reflected light. `lamps` (n, 20): frame (12), direction to the lamp (3), colour (3), softness, texel."""
    specular, rough, metal, skin = look[3], look[4], look[6], look[7]
    up = F(0.5) + F(0.5) * N[2]
    diffuse = ambience[0] * up + ambience[1] * (F(1) - up)
    shine = np.zeros(3, np.float32)
    alpha = max(rough * rough, F(0.02))
    nv = max((N * V).sum(), F(0.02))
    for n in range(len(lamps)):
        lamp = lamps[n]
        L = lamp[12:15]
        nl = (N * L).sum()
        if nl <= F(-0.4) * skin:
            continue
        Q = P + N * F(0.004)
        x = lamp[0] * Q[0] + lamp[1] * Q[1] + lamp[2] * Q[2] + lamp[3]
        y = lamp[4] * Q[0] + lamp[5] * Q[1] + lamp[6] * Q[2] + lamp[7]
        z = lamp[8] * Q[0] + lamp[9] * Q[1] + lamp[10] * Q[2] + lamp[11] - F(0.002)
        seen = lit(maps[n], x, y, z, lamp[18], lamp[19])
        if seen <= 0:
            continue
        glow = lamp[15:18] * seen
        straight = max(nl, F(0))
        wrapped = max((nl + F(0.4)) / F(1.4), F(0))
        spread = np.array([F(1.0), F(0.55), F(0.45)], np.float32) * skin
        diffuse += glow * (straight + (wrapped - straight) * spread)
        if straight > 0:
            H = L + V
            H /= np.sqrt((H * H).sum())
            nh = max((N * H).sum(), F(0))
            d = nh * nh * (alpha * alpha - F(1)) + F(1)
            fresnel = specular + (F(1) - specular) * (F(1) - max((V * H).sum(), F(0))) ** 5
            gloss = alpha * alpha / (F(3.14159) * d * d) * fresnel / (F(4) * max(straight * nv, F(0.05)))
            shine += glow * min(gloss * straight, F(6))
    mirror = F(2) * nv * N[2] - V[2]
    sky = ambience[0] * (F(0.5) + F(0.5) * mirror) + ambience[1] * (F(0.5) - F(0.5) * mirror)
    fringe = specular + (F(1) - specular) * (F(1) - nv) ** 5 * (F(1) - rough)
    shine += sky * fringe
    tint = F(1) - metal + albedo * metal
    colour = albedo * diffuse * (F(1) - metal * F(0.75)) + shine * tint
    return colour[0], colour[1], colour[2]
