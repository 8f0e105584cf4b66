"""Interchangeable ways to answer one question, one folder per question; the stage that asks holds the registry."""
