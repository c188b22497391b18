"""All kernels of a cycle give the same numbers as machine code and as the Python they are made of.

Golden counts of a slide go through both; the kernels' Python runs in a process without compiler.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

from tests.house.sources import ROOT
from tests.skin.test_values import FOLDER, PLANS, contacts, decoded

CYCLES = slice(0, None, 80)
USED = ("default", "accurate")
"""Of the plans: single and double numbers, one and two sweeps."""
WITHOUT_COMPILER = """
import sys
import numpy as np
from tests.skin.test_kernels import everything
np.seterr(all="ignore")
np.savez(sys.argv[1], **everything())
"""


def everything():
    """Readings of the plans, and contacts."""
    with np.load(FOLDER / "counts.npz") as file:
        counts, status = file["counts"][CYCLES], file["status"][CYCLES]
    found = {
        f"{plan}: {name}": values
        for plan in USED
        for name, values in decoded(counts, status, PLANS[plan]).items()
    }
    return found | {f"contacts: {name}": v for name, v in contacts(counts, status).items()}


@pytest.mark.usefixtures("machine_code")
@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="kernels are interpreted")
def test_machine_code_and_python_give_the_same_numbers(tmp_path):
    subprocess.run(
        [sys.executable, "-c", WITHOUT_COMPILER, tmp_path / "plain.npz"], cwd=ROOT, check=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    compiled = everything()
    with np.load(tmp_path / "plain.npz") as plain:
        assert set(plain.files) == set(compiled)
        for name, values in compiled.items():
            if values.dtype.kind != "f":
                np.testing.assert_array_equal(values, plain[name], name)
                continue
            # only machine code fuses products into sums
            least = 1e-4 * np.nanmax(np.abs(values), initial=1e-12)
            np.testing.assert_allclose(values, plain[name], rtol=1e-3, atol=least, err_msg=name)
    assert len(compiled["contacts: load"]) > 0
