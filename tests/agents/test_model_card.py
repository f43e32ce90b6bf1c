"""The page of a policy's card: it has all entries of the card, and no entry breaks the page."""

from dataclasses import replace

import onnx
import yaml

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.policies.bundle import BundlePolicy, write_bundle
from turtlebot_gym_agents.policies.model_card import model_card
from turtlebot_gym_agents.policies.named import pretrained_folder

SHIPPED = pretrained_folder() / "ppo-nav.onnx"


def test_a_shipped_policy_has_a_page_with_its_card_and_its_results(capsys):
    assert main(["card", "ppo-nav"]) == 0
    page = capsys.readouterr().out
    head, card = page.split("---\n")[1], BundlePolicy(SHIPPED).card
    assert yaml.safe_load(head)["license"] == "mit"
    for fact in (card.env, card.robot["name"], "10 Hz", card.training["commit"], BundlePolicy(SHIPPED).sha256):
        assert str(fact) in page
    assert page.endswith(SHIPPED.with_suffix(".md").read_text(encoding="utf-8").partition("\n")[2])


def test_text_on_a_card_stays_in_its_cell(tmp_path):
    card = replace(BundlePolicy(SHIPPED).card, noise="a | b\n# c <script>", training={"x": {"y": [1, None]}, "z|": 0.123456})
    path = tmp_path / "own.onnx"
    write_bundle(path, onnx.load(SHIPPED), card)
    rows = [line for line in model_card(path).splitlines() if line.startswith("|")]
    assert r"| noise | a \| b # c &lt;script&gt; |" in rows
    assert rows[-3:-1] == ["| training: x | y [1, None] |", r"| training: z\| | 0.1235 |"]
    assert "## Measured" not in model_card(path)


def test_the_page_is_written_once_and_only_of_bundles(tmp_path, capsys):
    page = tmp_path / "card.md"
    assert main(["card", "ppo-nav", "--out", str(page)]) == 0
    assert page.read_text(encoding="utf-8") == model_card(SHIPPED)
    assert main(["card", "ppo-nav", "--out", str(page)]) == 2
    assert main(["card", "bearing"]) == 2
    exists, other = capsys.readouterr().err.splitlines()
    assert "overwrite it with --force" in exists
    assert other == "turtlebot-gym: policy must be a bundle, FILE.onnx, or a trained policy of the package, got 'bearing'."
