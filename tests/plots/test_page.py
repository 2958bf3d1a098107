"""Results as one page: what is on it, that it needs nothing else, that nothing given gets into its markup, what is refused."""

from __future__ import annotations

import os
import re
import warnings
from html.parser import HTMLParser

import dask.array
import numpy as np
import pytest
import xarray as xr
from mast_scenes import small
from public_calls import MAST, datasets
from scenes import SOFT

import cablepod as cp

pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")
#: A text that would be markup, and a script, if it were not escaped.
HOSTILE = '<script>alert("1 & 2")</script><img src=x onerror=y>\u202e'
#: Elements without an end.
VOID = {"meta", "img", "br"}


class Reader(HTMLParser):
    """Elements with their attributes, the texts of cells, and the open elements, which must close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.rows: list[list[str]] = []
        self.texts: list[str] = []
        self.style: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
        if self.open:
            (self.style if self.open[-1] == "style" else self.texts).append(data)

    def row(self, first: str) -> list[str]:
        """The first row that begins with a text."""
        return next(row for row in self.rows if row and row[0] == first)


@pytest.fixture
def page(tmp_path):
    """Write a page and read it."""

    def write(results, **options):
        path = cp.plots.report(results, tmp_path / "page.html", **options)
        assert path == tmp_path / "page.html"
        return Reader(path.read_text(encoding="utf-8"))

    return write


def text_of(reader):
    return " ".join(reader.texts)


# --- what is on it ----------------------------------------------------------------------------------------------------------


def test_wide_tables_scroll_and_print(page):
    """The page itself never scrolls sideways: every table is in a box that does, long lines too; print has no boxes."""
    table = [{f"a long heading {k} [m]": 1.0 for k in range(9)}]
    columns, sentence = "a  b  " + "wide  " * 30, "one sentence without columns " * 8
    reader = page({"scene": cp.make_scene(SOFT)}, text=f"{columns}\n{sentence}", tables={"Wide": table})
    tags = [(tag, attrs.get("class")) for tag, attrs in reader.elements]
    tables = [i for i, (tag, _) in enumerate(tags) if tag == "table"]
    assert tables
    assert all(tags[i - 1] == ("div", "wide") for i in tables)
    assert ("pre", "long") in tags
    lines = next(text for text in reader.texts if text.startswith("a  b")).splitlines()
    assert lines[0] == columns
    assert max(map(len, lines[1:])) < 100  # broken between words
    assert " ".join(" ".join(lines[1:]).split()) == sentence.strip()
    style = "".join(reader.style)
    screen, _, print_ = style.partition("@media print")
    assert ".wide { overflow-x: auto; }" in screen
    assert ".wide { overflow: visible; }" in print_
    assert re.search(r"pre \{[^}]*white-space: pre;[^}]*overflow-x: auto", screen)
    assert re.search(r"pre \{[^}]*white-space: pre-wrap", print_)


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """A study, and its page."""
    study = cp.study.run(cp.make_scene(SOFT), ranks=(1,))
    path = cp.plots.report(study, tmp_path_factory.mktemp("study") / "page.html")
    return study, path.read_text(encoding="utf-8")


def test_a_study_has_all_parts(studied):
    study, found = studied[0], Reader(studied[1])
    headings = [attrs["id"] for tag, attrs in found.elements if tag == "section"]
    assert headings == ["warnings", "figures", "input", "numbers", "trust", "provenance"]
    assert {attrs["href"] for tag, attrs in found.elements if tag == "a"} == {f"#{name}" for name in headings}
    said = text_of(found)
    assert study.attrs["title"] in said
    for node in study.children.values():  # each result by its id
        assert node.attrs["id"] in said
    assert found.row("cablepod")[1] == cp.__version__
    assert found.row("cable.top_tension")[1:3] == ["200", "N"]
    captions = [attrs["alt"] for tag, attrs in found.elements if tag == "img"]
    assert any(caption.startswith("chain: tension over time") for caption in captions)
    assert any(
        caption.startswith("chain and ") and "_r1 (the least estimated error): deflection" in caption
        for caption in captions
    )
    # the estimate of the model, in per cent
    estimate = 100.0 * study["condensed_r1"].attrs["error_estimate"]
    head = next(row for row in found.rows if row[:2] == ["result", "model"])
    assert float(found.row("condensed_r1")[head.index("model [%]")]) == pytest.approx(estimate, rel=5e-3)


def test_numbers_are_in_units_for_people(page):
    dataset = xr.Dataset(
        {
            "force": ("guy", [12345.0, 20000.0], {"units": "N"}),
            "shift": ("guy", [0.0123, 0.5], {"units": "m"}),
            "angular_frequency": ("mode", [2.0 * np.pi, 4.0 * np.pi], {"units": "rad s-1"}),
            "utilisation": ("guy", [0.25, np.nan], {"units": "1"}),
            "length": ((), 61.2, {"units": "m", "long_name": "length of it"}),
            "strain_still_air": ((), 0.0004, {"units": "1", "long_name": "strain in still air"}),
            "axial": ((), 2.0 * np.pi, {"units": "rad s-1", "long_name": "angular one"}),
            "axial_hertz": ((), 1.0, {"units": "Hz", "long_name": "axial frequency"}),
            "tension": (("time", "link"), [[1000.0, 2000.0], [3000.0, 6000.0]], {"units": "N", "long_name": "pull"}),
        },
        coords={"guy": [1, 2]},
    )
    found = page(dataset)
    assert ["guy", "force [kN]", "shift [mm]", "utilisation [%]"] in found.rows
    assert ["1", "12.345", "12.3", "25"] in found.rows
    assert ["2", "20", "500", "-"] in found.rows
    assert ["mode", "frequency [Hz]"] in found.rows
    assert ["2", "2"] in found.rows
    assert found.row("length of it") == ["length of it", "61.2 m"]
    assert found.row("strain in still air")[1] == "0.04 %"
    assert [row for row in found.rows if row[-1] == "1 Hz"] == [["axial frequency", "1 Hz"]]
    assert found.row("pull [kN]") == ["pull [kN]", "time 2, link 2", "1", "3", "6"]


def test_tables_of_a_caller_are_in_units_for_people(page):
    rows = [
        {"guy": 1, "peak [N]": 21300.0, "speed [m/s]": 20.0, "utilisation [1]": 0.5, "slack": "3 (2)"},
        {"guy": 2, "peak [N]": None, "speed [m/s]": 25.0, "utilisation [1]": 0.125},
    ]
    found = page(xr.Dataset({"a": 1.0}), tables={"Guys": rows}, text="  kept   as it is")
    assert ["guy", "peak [kN]", "speed [m/s]", "utilisation [%]", "slack"] in found.rows
    assert ["1", "21.3", "20", "50", "3 (2)"] in found.rows
    assert ["2", "-", "25", "12.5", "-"] in found.rows
    assert "  kept   as it is" in found.texts


def test_a_table_with_many_columns_is_divided_and_keeps_its_first_one(page):
    values = {f"v{i}": ("guy", [float(i), 2.0 * i]) for i in range(10)}
    found = page(xr.Dataset(values, coords={"guy": [7, 8]}))
    heads = [row for row in found.rows if row[0] == "guy"]
    assert heads == [["guy", *(f"v{i}" for i in range(7))], ["guy", "v7", "v8", "v9"]]


def test_long_variables_are_told_by_their_range_and_lazy_ones_only_if_small(page):
    values = xr.Dataset({"a": ("time", np.arange(100.0))}).chunk({"time": 10})
    assert page(values).row("a")[1:] == ["time 100", "0", "49.5", "99"]
    large = dask.array.zeros(10**12, chunks=10**9)
    assert page(xr.Dataset({"a": ("time", large)})).row("a")[1:3] == ["time 1000000000000", "not read"]


def test_variables_without_values_are_left_out(page):
    found = page(xr.Dataset({"absent": ("level", np.zeros(0)), "pull": ("guy", [1.0])}))
    assert ["guy", "pull"] in found.rows
    assert "absent" not in text_of(found)


def test_coordinates_and_ends_are_columns_or_rows_where_nothing_else_is(page):
    both = xr.Dataset(
        {"anchor": (("guy", "coordinate"), [[1.0, 2.0]]), "pull": ("end", [3.0, 4.0])},
        coords={"guy": [7], "coordinate": ["x", "y"], "end": ["lower", "upper"]},
    )
    found = page(both)
    assert [row for row in found.rows if row[0] in ("guy", "7")] == [["guy", "anchor x", "anchor y"], ["7", "1", "2"]]
    assert [row for row in found.rows if row[0] in ("end", "upper")] == [["end", "pull"], ["upper", "4"]]


def test_what_several_results_have_stands_once(page):
    first = xr.Dataset({"length": ((), 3.0, {"long_name": "the length"}), "pull": ("guy", [1.0, 2.0])})
    second = xr.Dataset({"length": ((), 3.0, {"long_name": "the length"}), "pull": ("guy", [1.0, 2.0])})
    other = xr.Dataset({"length": ((), 4.0, {"long_name": "the length"})})
    found = page({"one": first, "two": second, "three": other})
    assert [row for row in found.rows if row[0] == "the length"] == [["the length", "3"], ["the length", "4"]]
    assert len([row for row in found.rows if row == ["guy", "pull"]]) == 1


def test_the_input_of_a_single_result_is_that_of_its_history(page):
    scene = cp.make_scene(SOFT)
    found = page(cp.catenary.rest(scene))
    direct = page({"scene": scene})
    for key in ("cable.top_tension", "ends.upper", "motion.upper.x.amplitude", "chain.links"):
        assert found.row(key)[:3] == direct.row(key)[:3], key
    wind = {"wind": {"speed": 5.0, "direction": [1.0, 0.0]}, "cable": {**SOFT["cable"], "diameter": 0.01}}
    windy = cp.make_scene({**SOFT, **wind})
    for result in (
        cp.catenary.rest(windy),
        {"scene": windy},
    ):  # what drives the drag is told where the scene leaves it out
        assert page(result).row("cable.drag_coefficient")[1] == "1.2"
    assert "cable.drag_coefficient" not in text_of(found)


def test_the_input_of_members_is_the_range_of_what_they_vary(page):
    """Also by the history of their result, whose scene has the value before it was varied."""
    ranges = {"cable.top_tension": [150.0, 250.0, 2], "gravity": [9.0, 10.0, 2]}
    scenes = cp.ensemble.design(cp.make_scene(SOFT), ranges)
    for given in ({"scene": scenes}, cp.catenary.rest(scenes)):
        assert page(given).row("cable.top_tension")[1:3] == ["150 to 250, 2 values", "N"]


def test_numbers_at_rest_in_wind_stand_once_for_each_air(page):
    wind = {"wind": {"speed": 5.0, "direction": [1.0, 0.0]}, "cable": {**SOFT["cable"], "diameter": 0.01}}
    found = page(cp.summary(cp.make_scene({**SOFT, **wind})))
    of_sag = [
        row[0].partition(", in ")[2] for row in found.rows if row[0].startswith("largest distance of the cable from")
    ]
    assert of_sag == ["still air", "the mean wind"]


def test_a_mast_has_the_figures_of_its_guys_and_modes(page):
    run, frequencies = datasets()["mast run"], datasets()["mast frequencies"]
    found = page({"motion": run, "frequencies": frequencies, "scene": cp.make_scene(MAST)})
    captions = [attrs["alt"] for tag, attrs in found.elements if tag == "img"]
    assert captions[0] == "motion: tension of each guy at the mast over time"
    assert any("bending moment" in caption for caption in captions)
    assert any("shapes of vibration" in caption for caption in captions)


def test_rounding_is_neither_printed_nor_drawn(page):
    rest = cp.mast.rest(small(lambda mapping: mapping.update(wind={"speed": 20.0, "direction": [1.0, 0.0, 0.0]})))
    moments = rest["bending_moment"]
    noise = 1e-11 * float(abs(moments).max())  # as of rounding, whatever this machine has
    rest = rest.assign(bending_moment=moments.where(moments.coordinate != "z", noise))
    rest = rest.assign(foot_force=rest["foot_force"].where(rest["foot_force"].coordinate != "z", -noise))
    found = page(rest)
    captions = [attrs["alt"] for tag, attrs in found.elements if tag == "img"]
    assert len([caption for caption in captions if "displacements along x" in caption]) == 1
    assert not any("displacements along z" in caption for caption in captions)
    column = next(row for row in found.rows if any(cell.startswith("foot force") for cell in row))
    assert len(column) == 2  # a row for each coordinate
    assert found.row("z")[column.index(next(cell for cell in column if cell.startswith("foot force")))] == "0"
    parts = xr.Dataset(
        {"gap": ("guy", [1.0, 2e-9, 2e-10], {"units": "m"}), "load": ("guy", [3e-7, 2e-7, 1e-7], {"units": "N"})}
    )
    assert [row[1:] for row in page(parts).rows if row[0] in "123"] == [
        ["1", "3e-07"],
        ["2e-09", "2e-07"],
        ["0", "1e-07"],
    ]


def test_pictures_of_a_mast_mark_what_breaks_and_what_is_not_to_scale():
    run, frequencies = datasets()["mast run"], datasets()["mast frequencies"]
    first, last = float(run.time[0]), float(run.time[-1])
    breaks = np.full(run.sizes["guy"], np.inf)
    axes = cp.plots.guy_tensions(run.assign_coords(guy_breaks=("guy", breaks)))
    assert not axes.texts
    breaks[1] = first + 0.75 * (last - first)
    axes = cp.plots.guy_tensions(run.assign_coords(guy_breaks=("guy", breaks)))
    assert [text.get_text() for text in axes.texts] == ["guy 2 breaks"]
    picked = cp.plots.guy_tensions(run.assign_coords(guy_breaks=("guy", breaks)).isel(guy=[2, 1]))
    assert [text.get_text() for text in picked.texts] == ["guy 2 breaks"]
    assert [line.get_label().split(",")[0] for line in picked.lines[:2]] == ["guy 3", "guy 2"]
    assert any(list(line.get_xdata()) == [breaks[1]] * 2 for line in axes.lines)
    breaks[1] = last + 1.0  # after the run
    assert not cp.plots.guy_tensions(run.assign_coords(guy_breaks=("guy", breaks))).texts
    few = cp.plots.guy_tensions(run.assign(guy_tension=run.guy_tension.copy(data=1e-4 * run.guy_tension)))
    assert [one.get_ylabel() for one in (axes, few)] == ["tension at the mast [kN]", "tension at the mast [N]"]
    assert "not to scale" in cp.plots.mast_shapes(frequencies).get_xlabel()


@pytest.mark.parametrize(
    "name", ["catenary", "modes", "orbit", "response", "free", "map", "gusts", "members", "comparison"]
)
def test_every_kind_of_result_makes_a_page(page, name):
    found = page(datasets()[name])
    assert datasets()[name].attrs["id"] in text_of(found)


def test_a_figure_that_cannot_be_drawn_is_left_out_with_the_reason(page):
    run = datasets()["chain"]
    assert "Left out:" not in page(run).texts
    found = page(run.assign(position=0.0 * run["position"]))  # without a chord there is no deflection
    assert "Left out:" in found.texts
    assert any("deflection" in said and "given ends that coincide; allowed: " in said for said in found.texts)


# --- warnings ---------------------------------------------------------------------------------------------------------------


def items(reader):
    """The warnings, each a text of a list."""
    return [said for said in reader.texts if said.strip()]


def test_every_warning_that_was_given_is_on_the_page(page):
    scene = cp.make_scene({**SOFT, "load": {"uniform": [0.0, 30.0], "kind": "ramp", "amplitude": 1.0, "duration": 1.0}})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = cp.condensed.simulate(scene, datasets()["normal modes"], step=1e-3, times=[0.0, 1.0])
    texts = [str(item.message) for item in caught]
    assert texts
    assert set(texts) <= set(items(page(run, warnings=texts)))
    (slack,) = (text for text in texts if "the cable goes slack there" in text)  # which the run tells too
    assert len([said for said in items(page(run, warnings=texts)) if said.endswith(slack)]) == 1
    # without them the run itself tells what is outside of the range of its model
    own = items(page(run))
    assert any("the cable goes slack there" in said for said in own)


def test_results_tell_what_is_doubtful(page):
    results = {
        "summary": xr.Dataset({"note": ((), "density: 8, likely in g/cm3\ngravity: 98")}),
        "chain": xr.Dataset(
            {"tension_minimum": ("link", [0.0, 5.0]), "position": ("particle", np.zeros(3))},
            attrs={"incomplete": "stopped at 3 s of 10 s", "time_error_estimate": 0.02, "space_error_estimate": 0.05},
        ),
        "mast": xr.Dataset({"guy_tension_minimum": ("guy", [3.0, 0.0, -1.0])}, coords={"guy": [1, 2, 5]}),
        "runs": xr.Dataset(
            {
                "failure": ("member", ["", "diverged", ""]),
                "time_error_estimate": ("member", [1e-6, np.nan, 2e-4]),
                "error_estimate": ("member", [0.6, np.nan, 0.1]),
            },
            attrs={"accepted_time_error": 1e-4},
        ),
        "members": xr.Dataset(
            {
                "smallest_chordwise_force": ("member", [5.0, -1.0]), "time_of_smallest_force": ("member", [0.0, 2.0]),
                "step": ("member", [0.1, 0.1]),
            },
            attrs={"model": "condensed", "scheme": "velocity_verlet"},
        ),
    }  # fmt: skip
    tree = xr.DataTree.from_dict(results)
    tree.attrs = {"left_out": ["galerkin: needs two held ends"], "notes_left_out": 3}
    found = page(tree).texts
    for part in (
        "left out: galerkin: needs two held ends", "summary: density: 8, likely in g/cm3", "summary: gravity: 98",
        "chain: incomplete, stopped at 3 s of 10 s", "chain: not converged in time", "chain: too few links",
        "chain: slack at times: 1 of 2",
        "mast: slack at times: guy 2, 5", "runs: 1 of 3 members failed: diverged", "3 more notes",
        "members: 1 of 2 members, of these number 1 the worst: the chordwise force",
    ):  # fmt: skip
        assert len([text for text in found if text.startswith(part)]) == 1, part
    coarse = next(text for text in found if text.startswith("chain: too few links"))
    assert "try about 5 links" in coarse  # of two with an error of 5 %, by the square of their number
    assert "cable.simulate" in coarse
    assert len([text for text in found if text.startswith("runs: 1 of 3 members: estimated")]) == 2
    clean = {
        "chain": xr.Dataset(
            {"tension_minimum": ("link", [1.0])}, attrs={"time_error_estimate": 1e-5, "space_error_estimate": 5e-3}
        )
    }
    assert not [text for text in page(xr.DataTree.from_dict(clean)).texts if text.startswith("chain: ")]


# --- safe and self-contained --------------------------------------------------------------------------------------------------


def test_nothing_outside_the_page_is_needed(studied):
    content = studied[1]
    found = Reader(content)
    assert {tag for tag, _ in found.elements} & {"script", "link", "iframe", "object", "base", "form"} == set()
    for tag, attrs in found.elements:
        assert not any(name.startswith("on") for name in attrs), tag
        for name in ("src", "href"):
            assert (attrs.get(name) or "#").startswith(("data:image/png;base64,", "#")), (tag, attrs)
    assert not re.search(r"url\(|@import|https?:", re.sub(r'src="data:[^"]*"', "", content))
    policy = next(attrs["content"] for tag, attrs in found.elements if attrs.get("http-equiv"))
    assert policy.startswith("default-src 'none'")


def test_texts_of_users_are_no_markup(page, tmp_path):
    scene = cp.make_scene({**SOFT, "title": HOSTILE})
    dataset = xr.Dataset(
        {HOSTILE: ("guy", [1.0], {"units": HOSTILE, "long_name": HOSTILE}), "b": ((), 1.0, {"long_name": HOSTILE})},
        coords={"guy": [HOSTILE]},
        attrs={"title": HOSTILE, "stage": HOSTILE, "model": HOSTILE, "error_estimate": 0.1, "incomplete": HOSTILE},
    )
    found = page(
        {HOSTILE: dataset, "scene": scene}, text=HOSTILE, warnings=[HOSTILE], tables={HOSTILE: [{HOSTILE: HOSTILE}]}
    )
    assert {tag for tag, _ in found.elements} & {"script"} == set()
    assert all(attrs["src"].startswith("data:") for tag, attrs in found.elements if tag == "img")
    assert '<script>alert("1 & 2")</script>' in text_of(found)
    assert "\u202e" not in (tmp_path / "page.html").read_text(encoding="utf-8")  # would turn the text after it


def test_a_failed_write_leaves_the_old_page(tmp_path, monkeypatch):
    path = tmp_path / "page.html"
    path.write_text("old")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(cp.ArchiveError, match="No space"):
        cp.plots.report(datasets()["catenary"], path)
    assert path.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["page.html"]
    monkeypatch.undo()
    cp.plots.report(datasets()["catenary"], path)
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_results_are_not_changed(tmp_path):
    before = datasets()["chain"].copy(deep=True)
    cp.plots.report(datasets()["chain"], tmp_path / "page.html")
    assert datasets()["chain"].identical(before)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"results": None}, "results"),
        ({"results": {}}, "results"),
        ({"results": {"a": 1}}, "results"),
        ({"results": {1: xr.Dataset()}}, "results"),
        ({"results": xr.DataArray([1.0])}, "results"),
        ({"path": "page.txt"}, "path"),
        ({"path": "missing/page.html"}, "path"),
        ({"path": 3}, "path"),
        ({"text": 3}, "text"),
        ({"warnings": "one"}, "warnings"),
        ({"warnings": [1]}, "warnings"),
        ({"tables": [1]}, "tables"),
        ({"tables": {"a": "rows"}}, "tables"),
        ({"tables": {"a": [1]}}, "tables"),
    ],
)
def test_wrong_calls_are_refused_before_anything_is_written(options, key, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = {"results": datasets()["catenary"], "path": "page.html", **options}
    with pytest.raises(cp.SceneError, match=rf"^{key}: given .*; allowed: "):
        cp.plots.report(given.pop("results"), given.pop("path"), **given)
    assert list(tmp_path.iterdir()) == []


def test_runs_of_other_scenes_are_not_drawn_as_the_reduced_model_of_a_full_one(tmp_path):
    scene, times = cp.make_scene(SOFT), {"times": [0.0, 0.01], "step": 1e-3}
    modes = cp.condensed.vibration_modes(scene, rank=2)
    runs = {"full": cp.chain.simulate(scene, **times)}
    for name, one in (("other", cp.make_scene({**SOFT, "gravity": 9.0})), ("own", scene)):
        runs[name] = cp.condensed.simulate(one, modes, **times).assign_attrs(error_estimate=0.0)
        text = cp.plots.report(runs, tmp_path / "page.html").read_text(encoding="utf-8")
        assert "full and other" not in text
        assert ("full and own (the least estimated error): deflection" in text) == (name == "own")
