"""Pages that need nothing else, from the templates of a package and the style of all pages."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template


def page_template(package: str, name: str) -> "Template":
    """Returns a template of a package, which may include theme.html: colours, light and dark.

    Args:
        package: such as "airrace.evaluation", with a folder ``templates``.
        name: of the file there.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader

    packages = dict.fromkeys([package, "airrace.analysis"])
    templates = Environment(
        loader=ChoiceLoader([PackageLoader(each) for each in packages]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return templates.get_template(name)
