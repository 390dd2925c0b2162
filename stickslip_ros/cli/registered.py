# SPDX-License-Identifier: Apache-2.0
"""What other rooms register, for help texts, which then load none of them.

Written by ``python docs/tables.py``; ``make lint`` says when that is due.
"""

# ruff: noqa: E501
# fmt: off
METRICS = ('step_size', 'backstep', 'mean_speed', 'generated_force', 'zero_amplitude', 'zero_amplitude_intersection', 'blocking_preload')
TRIAL_STEPS = 12
LIMITS = {
    'rmse': ('m', 'root mean square difference'),
    'step-rmse': ('m', 'RMSE that adds up from step to step'),
    'shape-rmse': ('m', 'RMSE within the cycles'),
    'error': ('m', 'largest difference'),
    'normalised-error': ('', 'RMSE as part of the range'),
    'step-error': ('m', 'difference in step size'),
    'backstep-error': ('m', 'difference in backstep'),
    'zero-amplitude-error': ('m', 'difference in 0-amplitude'),
    'frequency-error': ('Hz', 'difference in ringing frequency'),
    'damping-error': ('', 'difference in damping ratio'),
    'offset': ('s', 'clock offset'),
}
COMMANDS = {
    'amplitude': ('amplitude V', 'peak to peak, from the next cycle on'),
    'frequency': ('frequency Hz', 'of stepping, from the next cycle on; the slip has to fit into the cycle'),
    'load': ('load N', 'external force along the axis; the other components are not used'),
    'steps': ('steps N', 'number of steps, the sign is the direction; 0 finishes the cycle and stops'),
    'jog': ('jog Hz', 'steps without end, the sign is the direction; 0 stops'),
    'scan': ('scan V', 'level to which the actuator moves slowly, without a slip'),
    'position': ('position m', 'target position; the closed loop with the simulated sensor goes there and holds it'),
    'trajectory': ('trajectory SECONDS:METRES ...', 'points (s, m) that the closed loop follows; it holds the last'),
    'joint_command': ('joint_command JOINT position|velocity VALUE', 'set point of a controller of ROS, position (m) or velocity (m/s), in closed loop'),
    'stop': ('stop', 'end the running command: steps after their cycle, a scan where it is'),
    'reset': ('reset', 'leave a fault'),
    'zero': ('zero', 'count positions from the present reading of the sensor on'),
    'enable': ('enable on|off', 'accept commands, or refuse them; disabling ends the running command as stop does'),
    'parameters': ('parameters NAME=VALUE ...', 'change parameters, all or none'),
}
COMPRESSIONS = ('none', 'lz4', 'zstd')
CONTROLLERS = {
    'anc300': (7230, 'attocube ANC300, console over TCP, password 123456'),
    'mcs': (5000, 'SmarAct MCS, ASCII interface'),
    'mcs2': (55551, 'SmarAct MCS2, SCPI interface'),
}
GUIDE = {
    'a': 0.015,
    'b': 0.005724,
    'c': 0.005,
    'e': 0.005,
}
