"""Each page in turn."""

import pytest
from pages import PAGES, ROOT


@pytest.fixture(params=PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def page(request):
    return request.param
