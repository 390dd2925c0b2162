# SPDX-License-Identifier: Apache-2.0
"""Axes that are no plain CEIM: a slow amplifier, a second contact, a preload that jumps, a law.

Two contacts and a first-order lag of the actuator, left to fourth-order Runge-Kutta steps of
fixed length that end at every kink. Nothing of the package is used.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np
from bench_traces import GAIN, SLEWRATE, Array, Axis, Drive


@dataclass(frozen=True)
class Other:
    """What makes an axis different; all 0: the CEIM alone."""

    lag: float = 0.0  #: time constant of the amplifier, s
    second: float = 0.0  #: stiffness of a second contact, in that of the first
    jump: float = 0.0  #: change of the preload half-way, as a part of it
    law: str = "ceim"  #: or lugre, epm_calc, epm_fix: with mu_k 0.2, mu_s 0.3, v_s 1 mm/s


@numba.njit(error_model="numpy", cache=True)  # type: ignore[untyped-decorator]
def _z_rate(z, w, z_ba, z_ss, z_limit, static):  # type: ignore[no-untyped-def]
    """Rate of z; LuGre has a z_ba of 0, and epm_calc a z_ss of 0, which then follows the limit."""
    alpha = 0.0
    size = abs(z)
    limit = z_limit
    if static > 0.0:
        limit = z_limit * (1.0 + static * math.exp(-((w / 1e-3) ** 2)))
    if z_ss == 0.0:
        z_ss = limit
    if z_ba == 0.0:
        alpha = 1.0
    elif z * w > 0.0 and size > z_ba:
        alpha = 1.0
        if size < z_ss:
            alpha = 0.5 + 0.5 * math.sin(math.pi * (size - 0.5 * (z_ss + z_ba)) / (z_ss - z_ba))
    return w - alpha * abs(w) / limit * z


@numba.njit(error_model="numpy", cache=True)  # type: ignore[untyped-decorator]
def _rates(y, wanted, rate, lag, c):  # type: ignore[no-untyped-def]
    """Rates of x, v, z, z of the second contact, u; wanted is u of the amplifier without lag."""
    out = np.empty(5)
    u_rate = rate if lag == 0.0 else (wanted - y[4]) / lag
    w = y[1] - u_rate
    one = _z_rate(y[2], w, c[3], c[6], c[4], c[7])
    two = _z_rate(y[3], w, 0.3 * c[3], 0.6 * c[3], 0.5 * c[4], 0.0)
    force = c[1] * y[2] + c[2] * one + c[5] * c[1] * y[3]
    out[0], out[1], out[2], out[3], out[4] = y[1], -force / c[0], one, two, u_rate
    return out


@numba.njit(error_model="numpy", cache=True)  # type: ignore[untyped-decorator]
def _run(kinks, rates, step, times, lag, before, after, change):  # type: ignore[no-untyped-def]
    found = np.zeros(len(times))
    y = np.zeros(5)
    wanted, at = 0.0, 0
    while at < len(times) and times[at] <= kinks[0]:
        at += 1
    for piece in range(len(rates)):
        length = kinks[piece + 1] - kinks[piece]
        count = max(1, math.ceil(length / step[piece]))
        h = length / count
        for k in range(count):
            t = kinks[piece] + k * h
            c = before if t < change else after
            r = rates[piece]
            a = wanted + r * k * h
            k1 = _rates(y, a, r, lag, c)
            k2 = _rates(y + 0.5 * h * k1, a + 0.5 * h * r, r, lag, c)
            k3 = _rates(y + 0.5 * h * k2, a + 0.5 * h * r, r, lag, c)
            k4 = _rates(y + h * k3, a + h * r, r, lag, c)
            new = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            while at < len(times) and times[at] <= t + h:
                p = (times[at] - t) / h
                q = 1.0 - p
                found[at] = (
                    q * q * (1.0 + 2.0 * p) * y[0]
                    + p * p * (1.0 + 2.0 * q) * new[0]
                    + h * p * q * (q * y[1] - p * new[1])
                )
                at += 1
            y = new
        wanted += rates[piece] * length
    while at < len(times):
        found[at] = y[0]
        at += 1
    return found


def _constants(axis: Axis, preload: float, other: Other) -> Array:
    changed = Axis(preload, axis.mass, axis.sigma_1, axis.sigma_0_offset, axis.sigma_0ss)
    mass, sigma_0, sigma_1, z_ba, z_ss, z_limit = changed.constants
    static = 0.0
    if other.law != "ceim":
        z_limit, static = 0.2 * preload / sigma_0, 0.5
        z_ba = {"lugre": 0.0, "epm_calc": 0.6 * z_limit, "epm_fix": z_ba}[other.law]
        z_ss = {"lugre": 0.0, "epm_calc": 0.0, "epm_fix": 1.4 * z_ba}[other.law]
    return np.array([mass, sigma_0, sigma_1, z_ba, z_limit, other.second, z_ss, static])


def other_trace(
    axis: Axis, other: Other, drive: Drive, rate: float, noise: float, seed: int
) -> tuple[Array, Array]:
    """Times (s) and positions (m) of an axis, sampled at a rate (Hz) with noise (m)."""
    period, slip = 1.0 / drive.frequency, drive.amplitude / SLEWRATE
    reach = GAIN * drive.amplitude
    kinks, rates, step = [drive.pause], [], []
    for k in range(drive.cycles):
        begin = drive.pause + k * period
        # Behind a slip the lag goes on: short steps as long as it does.
        soft = min(20.0 * other.lag + slip, 0.2 * period)
        kinks += [begin + soft, begin + period - slip, begin + period]
        rates += [reach / (period - slip)] * 2 + [-reach / slip]
        fine = slip / 60.0
        step += [fine if other.lag else 0.5e-6, 0.5e-6, fine]
    kinks.append(kinks[-1] + drive.pause)
    rates.append(0.0)
    step.append(0.05e-6 if other.lag else 0.5e-6)
    if other.lag:
        step = [min(one, 0.5e-6) for one in step]
    t = np.arange(0.0, kinks[-1], 1.0 / rate)
    after = _constants(axis, axis.preload * (1.0 + other.jump), other)
    x = _run(
        np.array(kinks), np.array(rates), np.array(step), t, other.lag,
        _constants(axis, axis.preload, other), after,
        drive.pause + (drive.cycles // 2 + 0.3) * period,
    )  # fmt: skip
    return t, x + noise * np.random.default_rng(seed).standard_normal(len(t))
