"""From annotations that know only their own frame to entities that live through a clip."""
