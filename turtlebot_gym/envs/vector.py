"""The vector environment of a device: what `gymnasium.make_vec` calls."""

from typing import Any

from gymnasium.vector import VectorEnv


def make_vector(num_envs: int = 1, *, device: str = "cpu", **options: Any) -> VectorEnv[Any, Any, Any]:
    """Make a vector environment.

    Args:
        num_envs: Number of environments.
        device: "cpu" for the engine, see `NavigationVectorEnv`, which returns numpy's arrays; or a device on which everything
            is a tensor of torch, see `NavigationDeviceEnv`: "cuda", "cuda:1" and so on, or "warp-cpu".
        **options: Those of the environment.
    """
    if device == "cpu":
        from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv

        return NavigationVectorEnv(num_envs, **options)
    from turtlebot_gym.envs.navigation_device import NavigationDeviceEnv

    return NavigationDeviceEnv(num_envs, device=device, **options)
