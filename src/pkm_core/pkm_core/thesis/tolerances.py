"""Values of chapter 4 and Table 7.5 of the thesis for comparison with ours; None if a cell is not legible."""

# Table 7.5: workspace [mm] along x and y
WORKSPACE_BOX = {'planar': (40.0, 21.0), 'xy_stage': (40.0, 40.0)}

# Table 4.1: value of the objective at the initial design, and l [mm], k [mm], value at the optimum.
# The initial design is printed as l = k = 130 mm; only 150 mm gives these values.
OBJECTIVES = {
    'f': (0.562, (70.0, 119.3, 0.0293)),
    'f1': (153.125, (70.0, 118.6, 3.535)),
    'f2': (626.627, (70.0, 116.6, 3.70)),
}

# Tables 4.2-4.5: end-point error on W when every link is 1 um too long, in um and, printed as mdeg, in urad.
STATISTICS = ('minimum', 'maximum', 'average', 'standard deviation')
ERRORS = {
    'Table 4.2, initial': {
        'x': (3.79, 106.09, 12.17, 15.89),
        'y': (3.79, 106.09, 12.17, 15.89),
        'z': (-91.66, -1.52, -8.86, 13.89),
        'phi': (-602.59, 602.59, None, 139.98),
    },
    'Table 4.3, optimum of f': {
        'x': (0.69, 1.05, 0.84, 0.093),
        'y': (0.69, 1.05, 0.84, 0.093),
        'z': (0.67, 0.89, 0.8, 0.052),
        'phi': (-2.8, 2.8, None, 1.25),
    },
    'Table 4.4, optimum of f1': {
        'x': (0.68, 1.03, 0.83, 0.089),
        'y': (0.68, 1.03, 0.83, 0.089),
        'z': (0.68, 0.89, 0.8, 0.049),
        'phi': (-2.72, 2.72, None, 1.225),
    },
    'Table 4.5, optimum of f2': {
        'x': (0.65, 0.96, 0.78, 0.079),
        'y': (0.65, 0.96, 0.78, 0.079),
        'z': (0.73, 0.9, 0.83, 0.042),
        'phi': (-2.47, 2.47, None, 1.147),
    },
}
