"""Execute notebooks in a clean kernel of this Python, and store them with their outputs: ``make notebooks``."""

import sys
from pathlib import Path

import nbformat
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient

for path in map(Path, sys.argv[1:]):
    print(path, flush=True)
    notebook = nbformat.read(path, as_version=4)
    kernel = AsyncKernelManager(kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))  # not one that the user has installed
    resources = {"metadata": {"path": str(path.parent)}}
    client = NotebookClient(notebook, km=kernel, resources=resources, timeout=600, coalesce_streams=True, record_timing=False)
    client.execute(cleanup_kc=True)
    nbformat.write(notebook, path)
