"""The axis that a workspace is described around, and whether all of it lies in one plane."""

from __future__ import annotations

import numpy as np

__all__ = ["azimuths_for", "flat_azimuth", "frame_of"]

FLAT = 1e-7  # of the arm's length


def flat_azimuth(tips: np.ndarray, length: float) -> float | None:
    """Azimuth (rad, 0 to π) of the plane through the z axis that holds all tips (K×3), if any."""
    _, values, rows = np.linalg.svd(tips[:, :2], full_matrices=False)
    if len(values) > 1 and values[1] > FLAT * length * np.sqrt(len(tips)):
        return None
    if values[0] <= FLAT * length * np.sqrt(len(tips)):
        return 0.0
    return float(np.mod(np.arctan2(rows[0, 1], rows[0, 0]), np.pi))


def frame_of(tips: np.ndarray, flat: float | None) -> np.ndarray:
    """Axes (3×3) to count angles in: the last one is z, or the middle of tips all on one side.

    Half-planes through an axis that passes beside the set would mostly miss it.
    """
    start = 0.0 if flat is None else flat
    upright = np.array(
        [[np.cos(start), -np.sin(start), 0], [np.sin(start), np.cos(start), 0], [0, 0, 1]]
    )
    if _surrounds(tips, flat):
        return upright
    rays = tips / np.maximum(np.linalg.norm(tips, axis=1), 1e-12)[:, None]
    axis = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
    first = upright[:, 0] if abs(axis @ upright[:, 0]) < 0.9 else upright[:, 2]
    side = first - axis * (axis @ first)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(axis, side), axis], axis=1)


def azimuths_for(tips: np.ndarray, frame: np.ndarray, count: int) -> np.ndarray:
    """Azimuths of `count` half-planes (rad, rising): even, but for those moved to where rims peak.

    Rims have a peak at each corner of the box of pressures; lines from one side of a peak to the
    other would cut it off.
    """
    even = np.arange(count) * 2 * np.pi / count
    x, y, z = (tips @ frame).T
    azimuth = np.mod(np.arctan2(y, x), 2 * np.pi)
    polar = np.arctan2(np.hypot(x, y), z)
    moved = even.copy()
    for k in np.argsort(-polar):
        away = np.abs(np.angle(np.exp(1j * (azimuth - azimuth[k]))))
        if polar[k] < polar[away < np.pi / count].max() or np.hypot(x[k], y[k]) < 1e-9:
            continue  # no peak
        i = int(np.argmin(np.abs(np.angle(np.exp(1j * (even - azimuth[k]))))))
        if moved[i] == even[i]:
            moved[i] = even[i] + np.angle(np.exp(1j * (azimuth[k] - even[i])))
    return np.sort(moved)


def _surrounds(tips: np.ndarray, flat: float | None) -> bool:
    """Whether the z axis passes through the tips: no gap of a third of a turn around it."""
    across = tips[:, :2]
    far = np.linalg.norm(across, axis=1) > 1e-9
    if flat is not None:
        side = across @ np.array([np.cos(flat), np.sin(flat)])
        return bool(side.min() <= 1e-9 and side.max() >= -1e-9)
    if not np.any(far):
        return True
    azimuths = np.sort(np.arctan2(across[far, 1], across[far, 0]))
    gaps = np.diff(np.append(azimuths, azimuths[0] + 2 * np.pi))
    return bool(gaps.max() < 2 * np.pi / 3)
