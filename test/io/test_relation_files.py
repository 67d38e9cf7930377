"""Known moves between poses: lines of eight finite numbers, or a clear line about what is not."""

from pathlib import Path

import pytest

from ogm_mcmc.errors import LogError
from ogm_mcmc.io.relation_files import read_relations


def test_remarks_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / 'relations'
    path.write_text('# stamps, move\n10 20 1 0 0 0 0 1.5\n\n20 25 9 8 0 0 0 0\n')
    assert read_relations(path).tolist() == [
        [10, 20, 1, 0, 0, 0, 0, 1.5],
        [20, 25, 9, 8, 0, 0, 0, 0],
    ]
    path.write_text('# none\n')
    assert read_relations(path).shape == (0, 8)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('1 2 3\n', '3 numbers in a line: expected 8'),
        ('1 2 3 4 5 6 7 nan\n', 'relation 1: expected finite numbers'),
        ('1 2 3 4 5 6 7 x\n', 'expected lines of eight numbers'),
    ],
)
def test_other_lines_are_refused(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / 'relations'
    path.write_text(text)
    with pytest.raises(LogError, match=expected):
        read_relations(path)
