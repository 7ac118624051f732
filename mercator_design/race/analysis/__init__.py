"""What a finished race says about its parameters: importance and ablation."""
