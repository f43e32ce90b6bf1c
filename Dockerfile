# For machines without Linux: environments, training, viewer and the ROS nodes, from PyPI alone.
#
#     docker build --tag turtlebot-gym .
#     docker run --rm -it -v "$PWD/runs:/home/robot/runs" turtlebot-gym turtlebot-gym train --out runs/nav
#     docker run --rm -v "$PWD/runs:/home/robot/runs" turtlebot-gym turtlebot-gym watch --html runs/drives.html
#
# Linux x86-64, since the ROS wheels are; on an Apple processor: docker build --platform linux/amd64.
FROM python:3.11-slim-bookworm

ENV PYTHONUNBUFFERED=1 PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
# Without a GPU's libraries, which take several gigabytes.
ARG PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu

RUN useradd --create-home robot
WORKDIR /opt/turtlebot-gym
COPY . .
RUN pip install --constraint constraints.txt '.[agents,ros]'

USER robot
WORKDIR /home/robot
# Machine code for this processor; another one compiles at first use.
RUN python -c "import gymnasium as gym; \
    [env.reset() and env.step(env.action_space.sample()) for name in ('Nav', 'Square', 'Rooms') \
    for env in [gym.make(f'turtlebot_gym:turtlebot_gym/TurtleBot{name}-v0')]]"
CMD ["turtlebot-gym", "--help"]
