"""`train --watch`: while it learns, the newest policy's episode can be watched, and its server ends with the training."""

from urllib.error import URLError
from urllib.request import urlopen

import pytest

from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train
from turtlebot_gym_view.training import WatchCallback

pytestmark = pytest.mark.touched("lab/turtlebot_gym_view", "tests/view")


def test_the_current_policy_is_shown_while_it_learns(tmp_path, capsys):
    class Visit(WatchCallback):
        """Looks at the view in the middle of the training."""

        def _on_rollout_start(self):
            super()._on_rollout_start()
            assert self.server is not None
            with urlopen(self.server.url, timeout=20.0) as answer:
                pages.append(answer.read().decode())
            labels.append(self.drive.read()[1].around.label)

    pages, labels = [], []
    hyper = {"n_envs": 64, "n_timesteps": 2048, "policy": "MlpPolicy", "n_steps": 16, "batch_size": 1024, "n_epochs": 1}
    config = TrainingConfig(config=hyper, steps=2048, evaluations=1, episodes=10)
    watch = Visit(config, seconds=0.0, port=0)
    train(config, tmp_path / "run", progress=False, callbacks=[watch])
    assert all("TurtleBotNav-v0 ppo seed 0" in page for page in pages)
    assert labels[0] == "after 0 steps"
    url = capsys.readouterr().out.split()[0]
    with pytest.raises(URLError):
        urlopen(url, timeout=5.0)
