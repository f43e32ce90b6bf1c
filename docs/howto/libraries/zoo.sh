configs=$(python -c "from turtlebot_gym_agents.training import hyperparameters as h; print(h.configs_folder())")
python -m rl_zoo3.train --algo ppo --env turtlebot_gym/TurtleBotNav-v0 --gym-packages turtlebot_gym \
    --conf-file "$configs/ppo.yaml" --hyperparams n_envs:64 batch_size:256 n_epochs:10 --n-timesteps 40960 \
    --eval-freq -1 --device cpu --seed 0 --log-folder logs
run=logs/ppo/turtlebot_gym-TurtleBotNav-v0_1
turtlebot-gym export $run --out nav.onnx --allow-pickle
