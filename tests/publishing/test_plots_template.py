"""The template that keeps DVC's page of plots offline."""

from card_data import REPOSITORY
from dvc_render import html


def test_plots_need_no_network():
    template = (REPOSITORY / "pipeline/publish/cards/template/plots.html").read_text()
    page = html.HTML(template).with_element("<p>a plot</p>").embed()
    assert "<p>a plot</p>" in page
    assert "http" not in page
    assert page.count('<script src="vega/') == 3
