"""Task: scenarios, the reward, N bicycles that ride to N goals, Gymnasium."""
