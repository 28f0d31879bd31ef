"""How the network of the detector `small` is made and measured: `python -m examples.training --help`.

Nothing of it is imported when the detector works. Only `train` needs torch and onnx (requirements.txt).
"""
