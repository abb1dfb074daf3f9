"""The published method, reproduced table by table. Millimetres and degrees, as in the paper."""
