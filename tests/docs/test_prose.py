"""The prose linter finds every phrase of its word list; `make check` lets it read the project's own texts."""

import prose
import pytest

RULES = prose.read_rules()


@pytest.mark.parametrize("rule", RULES, ids=[f"rule {number}" for number in range(len(RULES))])
def test_each_entry_of_the_word_list_is_found_in_its_sample(rule):
    for text in (rule.sample, f"The robot drives. {rule.sample}", rule.sample.replace(" ", "\n")):
        assert rule.pattern.search(text), text
    assert rule.write
    if rule.allow:
        assert not rule.pattern.search(rule.allow)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("page.md", "# A page\n\nIt stops where\nit believes to\nbe, in `code`.\n"),
        ("table.md", "| a |\n|---|\n| b |\n| it believes to be |\n"),
        ("module.py", 'def f():\n    """Return it.\n\n    It believes to be there.\n    """\n'),
        ("message.py", "\n\n\nraise ValueError(f'{1} believes to be there')\n"),
        ("params.yaml", "a: 1\nb: 2\nc:\n  d: 3  # It believes to be there\n"),
        ("robot.launch.xml", '<launch>\n  <arg name="a"/>\n\n  <arg name="b" description="it believes to be"/>\n</launch>\n'),
        ("test_name.py", "\n\n\ndef test_it_believes_to_be_there():\n    pass\n"),
        ("comment.py", "x = 1\n\n# It stops where it\n# believes to be.\n"),
    ],
)
def test_findings_name_file_and_line(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    (finding,) = prose.findings([tmp_path / name], RULES)
    assert (finding.path.name, finding.line) == (name, 4)
    assert str(finding).endswith("write 'believes it is'")


def test_code_is_not_read(tmp_path):
    (tmp_path / "page.md").write_text("Text with `it believes to be`.\n\n```python\n# it believes to be\n```\n")
    (tmp_path / "module.py").write_text('"""The field ``it believes to be`` is a name."""\ncolor = "gray"\n')
    assert not list(prose.findings([tmp_path], RULES))
