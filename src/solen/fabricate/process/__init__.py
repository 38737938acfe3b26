"""What a printer makes of images."""
