"""Networks: encoding of poses, layers, export to ONNX."""
