"""The notebook as a person runs it, in a kernel of its own: the test python_notebook. Another runs its cells."""

import nbclient
import nbformat
from conftest import NOTEBOOK


def test_the_notebook_runs_and_draws(process, patient, monkeypatch):
    monkeypatch.setenv("TELETACT_SERVICE", process.address)
    monkeypatch.setenv("TELETACT_PATIENT", str(patient[0]))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300).execute()
    pictures = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
                if "image/png" in output.get("data", {})]
    assert len(pictures) == 3
