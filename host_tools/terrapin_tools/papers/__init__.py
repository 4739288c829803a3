"""What three papers print, regenerated from the models and judged by stated rules: `terrapin papers`."""
