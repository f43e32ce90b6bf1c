"""The shell that turns a block into a node, and what it owns: conversion, triggers, freshness, parameters, the switch."""
