"""Test native vector environments against Gymnasium's contract."""

from gymnasium_vector_checker.contract import ContractError, Violation, check_vector_env

__all__ = ["ContractError", "Violation", "check_vector_env"]
