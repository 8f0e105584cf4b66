"""The library of afford: `import afford` refuses at once where a module of the user's hides `schemas`, which all of it needs."""

from afford.shadows import refuse

refuse(("schemas",))
