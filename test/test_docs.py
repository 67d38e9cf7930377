"""Documents that tell the truth: made pages are up to date, links lead somewhere."""

import re
from pathlib import Path

import parameter_pages as parameter_table
import pytest
import yaml

from ogm_mcmc.config import settings_of

LINK = re.compile(r'!?\[[^\]]*\]\(([^)\s]+)\)')
ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]


def anchors(text: str) -> set[str]:
    """Return the anchors that headings of a Markdown file get."""
    headings = re.findall(r'^#+ (.+)$', text, re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    text = document.read_text(encoding='utf-8')
    for target in LINK.findall(text):
        if target.startswith(('http://', 'https://')):
            continue
        name, _, anchor = target.partition('#')
        path = document.parent / name if name else document
        assert path.exists(), f'{document.name} links to {target}'
        if anchor:
            assert anchor in anchors(path.read_text(encoding='utf-8')), target


def test_parameter_page_is_made_from_the_code(repository):
    text = (repository / 'docs' / 'parameters.md').read_text(encoding='utf-8')
    assert text == parameter_table.page(), 'make it anew, see its first line'


@pytest.mark.parametrize('node', parameter_table.NODES)
def test_parameter_files_are_made_from_the_code(repository, node):
    text = (repository / 'config' / f'{node}.yaml').read_text(encoding='utf-8')
    assert text == parameter_table.parameter_file(node), 'make it anew, see its first line'


@pytest.mark.parametrize('node', parameter_table.NODES)
def test_parameter_files_hold_every_default(node):
    held = yaml.safe_load(parameter_table.parameter_file(node))['/**']['ros__parameters']
    configs, live = parameter_table.NODES[node]
    names = set()
    for config in configs:
        for leaf in settings_of(config):
            value = held
            for part in leaf.name.split('.'):
                value = value[part]
            assert value == leaf.default
            assert type(value) is leaf.type, f'{leaf.name}: ROS would refuse {value!r}'
            assert leaf.name not in names, f'{leaf.name} is declared twice'
            names.add(leaf.name)
    assert live <= names


def test_versions_agree(repository):
    import ogm_mcmc

    version = ogm_mcmc.__version__
    for name, pattern in (
        ('setup.py', rf"version='{version}'"),
        ('package.xml', rf'<version>{version}</version>'),
    ):
        assert re.search(pattern, (repository / name).read_text(encoding='utf-8')), name


def test_every_experiment_is_on_its_page(repository):
    from ogm_mcmc.lab.experiments import EXPERIMENTS

    text = (repository / 'docs' / 'evaluation.md').read_text(encoding='utf-8')
    named = re.findall(r'^\| `([\w-]+)` \|', text[text.index('## Experiments') :], re.MULTILINE)
    assert sorted(named) == sorted(EXPERIMENTS)
