"""Test native vector environments against Gymnasium's contract; it knows nothing of robots and works for any of them."""

from turtlebot_gym.checker.contract import ContractError, Violation, check_vector_env

__all__ = ["ContractError", "Violation", "check_vector_env"]
