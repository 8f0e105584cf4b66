"""The map of afford by target: which stage follows which. One line per stage; a stage knows no other."""
