"""Things in kitchens and workshops, and how they are gripped."""
