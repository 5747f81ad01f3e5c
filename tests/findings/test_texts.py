"""What people and detectors write in findings is data: on pages, in briefs, on the terminal and in files."""

from __future__ import annotations

import json
import re

import pytest
from PIL import Image
from test_findings import CUBE, HIGH, flown

from upplied.catalog import open_catalog
from upplied.cli import main
from upplied.errors import SettingsError, UppliedError
from upplied.findings.adding import add_marks
from upplied.findings.crops import write_crops
from upplied.findings.looks import Look, spot_of
from upplied.findings.marks import Mark, read_marks
from upplied.findings.photos import flight_of, register_photos
from upplied.findings.queries import by_reference
from upplied.findings.reshoot import plan_reshoot
from upplied.outputs.site import findings_html

SCRIPT = "</script><script>alert(1)</script><img src=x onerror=alert(2)>&\"'"
FORMULA = "=cmd|'/c calc'!A1"
PLACE = (float(HIGH[0]), 1.0, 4.0)


@pytest.fixture
def catalog(tmp_path):
    catalog = open_catalog(tmp_path / "catalog")
    catalog.add_structures([CUBE])
    catalog.add_demonstrations([flown()])
    return catalog


def mark(**texts: str) -> Mark:
    return Mark("it", place=PLACE, structure="cube-v1", **texts)


def test_no_text_of_a_finding_is_markup_on_its_pages(catalog, tmp_path):
    texts = {"class_name": SCRIPT, "severity": SCRIPT + "s", "note": SCRIPT + "n", "photo": SCRIPT + "p"}
    assert add_marks(catalog, [mark(**texts)], "Ada").new == 1
    page = findings_html("cube-v1", by_reference(catalog, "cube-v1"))
    assert "<script>alert" not in page and "<img src=x" not in page
    (text,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.DOTALL)
    assert SCRIPT in json.dumps(json.loads(text), ensure_ascii=False).replace('\\"', '"')
    row = catalog.findings().to_dict("records")[0]
    about = {"photo": SCRIPT, "path": "gone", "sha256": "", "mm_px": 1.0, "taken_at": None}
    look = Look(about, flown().positions[0], flown().quat_xyzw[0], flown().camera)
    shown, missing = write_crops(tmp_path / "crops", SCRIPT, [look], spot_of(row), CUBE)
    assert missing and "<script>" not in shown.read_text() and "<img src=x" not in shown.read_text()


def test_a_brief_shows_the_texts_of_its_findings_as_text(catalog, tmp_path):
    finding = Mark("it", SCRIPT, flight="past", t_s=10.0, pixels=((800.0, 595.0),), class_name=SCRIPT)
    assert add_marks(catalog, [finding], "Ada").new == 1
    reshoot = plan_reshoot(catalog, catalog.findings().to_dict("records"), "cube-v1", 6.0)
    file, where = tmp_path / "brief.html", ("--catalog", catalog.location)
    assert main(["brief", reshoot.transfer_id, "-o", str(file), "--draft", *where]) == 0
    brief = file.read_text()
    assert "<script>alert" not in brief and "<img src=x" not in brief and "&lt;script&gt;" in brief


@pytest.mark.parametrize("letter", ["\x1b", "\x00", "\x07", "\u202e", "\u2066", "\x9b", "\ud800"])
@pytest.mark.parametrize("name", ["class_name", "severity", "note"])
def test_what_a_terminal_obeys_or_turns_what_is_read_is_refused(catalog, letter, name):
    marks = add_marks(catalog, [mark(**{name: f"rust{letter}[2J"}), mark(class_name="rust")], "Ada")
    assert marks.new == 1 and "which nobody sees" in marks.refused[0] and marks.refused[0].isprintable()
    with pytest.raises(SettingsError, match="which nobody sees"):
        catalog.set_finding(marks.ids[0], "watched", "Ada", f"grows{letter}")


def test_a_photo_whose_name_a_terminal_would_obey_is_not_registered(catalog, tmp_path):
    (tmp_path / "photos").mkdir()
    for name in ("P\x1b[2J.png", "P\u202e.png", "P.png"):
        Image.new("RGB", (1600, 1190)).save(tmp_path / "photos" / name, compress_level=1)
    (tmp_path / "times.csv").write_text("name,t_s\nP.png,1\n")
    flight = flight_of(catalog, "past")
    new, refused = register_photos(catalog, flight, tmp_path / "photos", tmp_path / "times.csv")
    assert new == 1 and len(refused) == 2 and all("which nobody sees" in reason for reason in refused)
    assert all(reason.isprintable() for reason in refused)


def test_what_a_table_would_compute_stays_the_text_that_it_is(catalog, tmp_path, capsys):
    (tmp_path / "d.csv").write_text(
        f'structure,x_m,y_m,z_m,class,note\ncube-v1,{PLACE[0]},1,4,"{FORMULA}","=1+1"\n'
    )
    assert add_marks(catalog, read_marks(tmp_path / "d.csv"), "Ada").new == 1
    assert main(["findings", "list", "--json", "--catalog", catalog.location]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["class"], row["note"]) == (FORMULA, "=1+1")


def test_names_with_hidden_letters_are_refused_mark_by_mark(catalog, tmp_path, capsys):
    file = tmp_path / "marks.json"
    names = ["\x1b[2J.jpg", "\ud800.jpg", "\u202egpj.exe", "a\x00.jpg"]
    images = [{"id": at, "file_name": name} for at, name in enumerate(names)]
    boxes = [{"id": "\x1b]0;x\x07", "image_id": at, "bbox": [1, 2, 3, 4]} for at in range(len(names))]
    file.write_text(json.dumps({"images": images, "annotations": boxes}))
    assert main(["findings", "add", str(file), "--by", "Ada", "--catalog", catalog.location]) == 1
    message = capsys.readouterr().err
    assert message.count("which nobody sees") == 4 and "\x1b" not in message and "\x07" not in message
    file.write_text(json.dumps({"images": images, "annotations": [{**boxes[0], "bbox": [5, 5, -3, 4]}]}))
    with pytest.raises(UppliedError, match="a box of -3 x 4 px"):
        read_marks(file)
    far = Mark("it", place=(1e300, 0.0, 0.0), structure="cube-v1")
    assert "three coordinates" in add_marks(catalog, [far], "Ada").refused[0]
