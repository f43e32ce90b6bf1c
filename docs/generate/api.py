"""The API reference: for each package a page that lists its modules, and the pages of these from their docstrings."""

import sys
from pathlib import Path

import mkdocs_gen_files

sys.path.insert(0, str(Path("docs/generate").resolve()))
from layout import PACKAGES, headline, pages

ELSEWHERE = {
    "turtlebot_gym.envs.navigation": "environments.md",
    "turtlebot_gym.envs.navigation_vector": "vector_environments.md",
    "turtlebot_gym.systems.options": "environments.md",
}
"""Modules that are described on the pages of the environments."""
SEARCHED = "---\nsearch:\n  boost: 0.3\n---\n\n"
"""A search names these pages after those that explain."""


def row(name):
    """Return a module's line in a list of modules."""
    return f"| [`{name}`]({ELSEWHERE.get(name, f'{name}.md')}) | {headline(name)} |"


def write(page):
    """Write the page of a module or a package, and those under it."""
    with mkdocs_gen_files.open(page.path, "w") as file:
        file.write(SEARCHED)
        package = page.modules or page.under
        if page.name in ELSEWHERE:
            print(
                f"# {page.name} {{ #{page.name} }}\n\n{headline(page.name)}\n\nSee [the environments]({ELSEWHERE[page.name]}).",
                file=file,
            )
            return
        print(f"::: {page.name}\n    options:\n      heading_level: 1", file=file)
        if package:  # what a package re-exports stands where it is defined
            print("      members: []", file=file)
        if page.under:
            print("\n| module | |\n|---|---|", *(row(module.name) for module in page.under), sep="\n", file=file)
        for name in page.modules:
            print(f"\n::: {name}", file=file)
    for module in page.under:
        write(module)


for package, title in PACKAGES.items():
    contents = pages(package)
    with mkdocs_gen_files.open(f"reference/{package}.md", "w") as file:
        file.write(SEARCHED)
        print(f"# API: {package}\n\n{title}\n\n| package or module | |\n|---|---|", file=file)
        print(*(row(page.name) for page in contents), sep="\n", file=file)
        print(f"\n::: {package}\n    options:\n      members: []", file=file)
    for page in contents:
        write(page)
