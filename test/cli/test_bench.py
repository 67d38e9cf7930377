"""`bench refine`: what is timed can be judged, too."""

import json

from ogm_mcmc.cli import bench
from ogm_mcmc.cli.main import run


def test_every_input_is_refined_and_judged_with_one_meaning_of_no_return(monkeypatch, capsys):
    """Not `auto`, which only a recording as a whole can tell."""

    def timed(placed, config, patience):
        return {'no_return': config.window.no_return, 'scans': len(placed)}

    monkeypatch.setattr(bench, 'time_refining', timed)
    monkeypatch.setattr(bench, 'recorded_office', lambda: ['a scan'])
    assert run(['bench', 'refine']) == 0
    result = json.loads(capsys.readouterr().out)
    assert {name: one['no_return'] for name, one in result.items()} == {
        'scene': 'clear',
        'office': 'clear',
    }
    assert result['scene']['scans'] > 0
    assert result['office']['scans'] == 1
