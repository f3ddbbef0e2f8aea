"""Writing figures: as PNG and PDF, whole or not at all, equal bytes for equal flights."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from swarm_mj.figures.run_figures import draw
from swarm_mj.figures.style import new_figure, save, write
from swarm_mj.figures.units import instant, shown_spacecraft, time_axis


def test_same_flight_gives_the_same_bytes_even_in_threads(flown, written, tmp_path):
    names = ["tracking_error", "coverage", "links", "footprints"]

    def drawn_anew(name):
        draw(name, tmp_path, *flown)
        return (tmp_path / f"{name}.png").read_bytes()

    with ThreadPoolExecutor(3) as pool:
        drawn = list(pool.map(drawn_anew, names))
    assert drawn == [(written / f"{name}.png").read_bytes() for name in names]


def test_pdf_is_written_beside_the_png_only_on_request(written):
    assert (written / "operation.pdf").read_bytes().startswith(b"%PDF-")
    assert len(list(written.glob("*.pdf"))) == 1


def test_pdf_of_a_body_with_thousands_of_faces_stays_small(written):
    assert (written / "operation.pdf").stat().st_size < 1_000_000


def test_same_figure_gives_the_same_pdf(tmp_path):
    for name in ("one", "two"):
        figure = new_figure(2.0, "title")
        figure.subplots().plot([1, 2], [3, 4])
        write(figure, tmp_path / f"{name}.png", pdf=True)
    assert (tmp_path / "one.pdf").read_bytes() == (tmp_path / "two.pdf").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.pdf", "one.png", "two.pdf", "two.png"]


@pytest.mark.parametrize("suffix", ["png", "pdf"])
def test_failed_picture_leaves_the_earlier_one(tmp_path, suffix):
    path = tmp_path / f"picture.{suffix}"
    path.write_bytes(b"earlier")
    figure = new_figure(2.0, "title")
    figure.text(0.5, 0.5, "$\\nonsense$")
    with pytest.raises(ValueError, match="nonsense"):
        save(figure, path)
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_words_for_times():
    assert instant(600.0, time_axis(1200.0)) == "10 min"
    assert instant(90.0, time_axis(120.0)) == "90 s"
    assert instant(7200.0, time_axis(86_400.0)) == "2 h"


def test_of_many_spacecraft_the_first_and_the_last_are_shown():
    assert shown_spacecraft(25).tolist() == [*range(19), 24]
