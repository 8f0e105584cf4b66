"""6-DoF grasp candidates from masks and depth."""
