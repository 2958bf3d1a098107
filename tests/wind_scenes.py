"""The guy of the tests of wind, and its wind."""

GUY = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 15000.0, "diameter": 0.016},
    "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]},
    "chain": {"links": 20},
    "time": {"duration": 60.0, "interval": 0.1},
}
WIND = {"speed": 25.0, "direction": [1.0, 0.0, 0.0]}
KAIMAL = {**WIND, "turbulence": {"spectrum": "kaimal", "seed": 7}}
