"""Solver against solver on one linearised joint problem: `python benchmarks/public/solvers.py [20 60 600]`.

The problem is that of the last step of `maximum-likelihood` on 20 s: sparse rows of all readings by
the motion (a spline), the body and the systematic errors, with priors. Longer ones are so many runs
of 20 s, each with its own motion, that share body and errors. Every solver gets the same rows, in a
process of its own that has imported all of them. Laying the rows out as it takes them (dense pieces,
a graph, a programme) is one time, the step from there another; the memory is what the process takes at
most beyond what it has with the rows.
"""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import scipy.sparse as sp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

Array = np.ndarray
Step = Callable[[], Array]
"""The step, from rows that are laid out."""
PIECE = 20.0
"""[s]"""
BLOCK = 7
"""Coefficients of one spline function."""
REACH = 6
"""Spline functions that are not zero at one instant."""
LENGTHS = (20, 60, 600)
PATIENCE = 180.0
"""[s]"""


def write_problem(path: Path) -> None:
    """Rows and residuals of the joint fit of 20 s at its end."""
    from general_solver import Residuals, noticed
    from recordings import recordings

    from steelyard.experiment.read import read_experiment

    source = next(each for name, each, _ in recordings() if name == "points-00")
    task, _, found = noticed(read_experiment(source))[-1]
    problem = Residuals(task, found.state)
    point = problem.point(found.state)
    # Off the minimum by a hundredth of what the border is, so that there is a step to make.
    point[problem.motion :] *= 1.01
    matrix = problem.jacobian(point).tocoo()
    np.savez(
        path, row=matrix.row, column=matrix.col, value=matrix.data, shape=matrix.shape,
        residual=problem.residual(point), motion=problem.motion,
    )  # fmt: skip


def read_problem(path: Path, copies: int) -> tuple[sp.csr_matrix, Array, int]:
    """Rows, residuals, and how many columns are the motion's; in so many runs."""
    with np.load(path) as file:
        shape, motion = file["shape"], int(file["motion"])
        one = sp.csr_matrix((file["value"], (file["row"], file["column"])), shape=shape)
        residual = file["residual"]
    # The border in units of its columns, which differ by many orders.
    size = np.sqrt(np.asarray(one[:, motion:].multiply(one[:, motion:]).sum(axis=0)).ravel())
    border = one[:, motion:] @ sp.diags(1 / np.where(size > 0, size, 1.0))
    left = sp.block_diag([one[:, :motion]] * copies, format="csr")
    rows = sp.hstack([left, sp.vstack([border] * copies)], format="csr")
    return rows, np.tile(residual, copies), copies * motion


def ours(A: sp.csr_matrix, r: Array, motion: int) -> Step:
    """steelyard's: banded Cholesky of the motion, the border by its Schur complement."""
    from steelyard.identification.model.accumulation import accumulate
    from steelyard.identification.model.segment import Rows

    copies = round(len(r) / ROWS_OF_ONE)
    width, together = motion // copies, REACH * BLOCK
    functions, border = width // BLOCK, A.shape[1] - motion
    runs = []
    for k in range(copies):
        own = slice(k * ROWS_OF_ONE, (k + 1) * ROWS_OF_ONE)
        left, residual = A[own, k * width : (k + 1) * width].tocsr(), r[own]
        left.sort_indices()
        # Rows of the border alone have no first column.
        column = np.append(left.indices, 0)[np.minimum(left.indptr[:-1], left.nnz)]
        some = np.diff(left.indptr) > 0
        first = np.where(some, np.minimum(column // BLOCK, functions - REACH), 0)
        order = np.argsort(first, kind="stable")
        dense = np.zeros((len(residual), together))
        entries = left.tocoo()
        dense[entries.row, entries.col - BLOCK * first[entries.row]] = entries.data
        by_border = A[own, motion:].toarray()
        parts = dense[order, None], by_border[order, None], residual[order, None]
        runs.append(Rows(first[order], parts[2], parts[0], parts[1]))

    def step() -> Array:
        parts = [
            accumulate(functions, border, [rows], width=together, block=BLOCK) for rows in runs
        ]
        reduced = [each.reduced() for each in parts]
        matrix, right = (sum(each) for each in zip(*reduced, strict=True))
        found = np.linalg.solve(matrix, right)
        return np.concatenate([*(each.motion_step(found) for each in parts), found])

    return step


def scipy_splu(A: sp.csr_matrix, r: Array, motion: int) -> Step:
    """SuperLU of the normal equations, symmetric mode."""
    from scipy.sparse.linalg import splu

    def step() -> Array:
        H = (A.T @ A).tocsc()
        factor = splu(
            H, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        return factor.solve(-(A.T @ r))

    return step


def scipy_lsmr(A: sp.csr_matrix, r: Array, motion: int) -> Step:
    """LSMR, columns scaled to unit length."""
    from scipy.sparse.linalg import lsmr

    def step() -> Array:
        size = np.sqrt(np.asarray(A.multiply(A).sum(axis=0)).ravel())
        scaled = A @ sp.diags(1 / size)
        return lsmr(scaled, -r, atol=1e-12, btol=1e-12, maxiter=20000)[0] / size

    return step


def casadi_ipopt(A: sp.csr_matrix, r: Array, motion: int) -> Step:
    """The quadratic programme by CasADi and IPOPT (MUMPS)."""
    import casadi as ca

    H = (A.T @ A).tocsc()
    H.sort_indices()
    x = ca.MX.sym("x", H.shape[0])
    g = ca.DM(A.T @ r)
    cost = ca.bilin(ca.DM(H), x, x) / 2 + ca.dot(g, x)
    options = {"ipopt": {"print_level": 0, "hessian_constant": "yes"}, "print_time": False}
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": cost}, options)
    return lambda: np.asarray(solver(x0=0)["x"]).ravel()


def gtsam_elimination(A: sp.csr_matrix, r: Array, motion: int) -> Step:
    """GTSAM's elimination. Factors in Python have three keys at most: a key is six spline functions,
    so that every row touches two of them and the border."""
    import gtsam

    copies = round(len(r) / ROWS_OF_ONE)
    width, together = motion // copies, REACH * BLOCK
    # Keys end where a run ends.
    edges = np.concatenate(
        [k * width + np.arange(0, width, together) for k in range(copies)] + [[motion]]
    )
    last = len(edges) - 1
    first_column = np.minimum.reduceat(A.indices, A.indptr[:-1])
    owner = np.searchsorted(edges, first_column, side="right") - 1
    order = np.argsort(owner, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)
    graph = gtsam.GaussianFactorGraph()
    for rows in groups:
        key, dense = int(owner[rows[0]]), A[rows]
        unit = gtsam.noiseModel.Unit.Create(len(rows))
        end = np.asfortranarray(dense[:, motion:].toarray())
        parts: list[object] = []
        for each in (key, key + 1):
            if each < last and (each == key or edges[each] // width == edges[key] // width):
                block = dense[:, edges[each] : edges[each + 1]]
                parts += [each, np.asfortranarray(block.toarray())]
        graph.add(gtsam.JacobianFactor(*parts, last, end, -r[rows], unit))

    def step() -> Array:
        found = graph.optimize()
        return np.concatenate([found.at(k) for k in range(last + 1)])

    return step


SOLVERS: dict[str, Callable[[sp.csr_matrix, Array, int], Step]] = {
    "steelyard (band and border)": ours,
    "scipy splu": scipy_splu,
    "scipy lsmr": scipy_lsmr,
    "CasADi, IPOPT": casadi_ipopt,
    "gtsam": gtsam_elimination,
}
ROWS_OF_ONE = 1


def peak() -> float:
    """Memory that this process has had at most [MiB]; what its parent had does not count."""
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) / 1024


def one(path: Path, name: str, copies: int) -> dict[str, float]:
    """CPU times [s], peak memory [MiB] and the cost after the step."""
    global ROWS_OF_ONE
    A, r, motion = read_problem(path, copies)
    ROWS_OF_ONE = len(r) // copies
    # What is imported once is no part of a step.
    for module in (
        "casadi",
        "gtsam",
        "scipy.sparse.linalg",
        "steelyard.identification.model.segment",
    ):
        importlib.import_module(module)
    with suppress(OSError):
        # Reading has peaks of its own: the kernel's count begins anew.
        Path("/proc/self/clear_refs").write_text("5")
    before = peak()
    start = time.process_time()
    step = SOLVERS[name](A, r, motion)
    laid_out = time.process_time()
    x = step()
    ended = time.process_time()
    taken = peak() - before
    left = A @ x + r
    return {
        "layout": laid_out - start, "step": ended - laid_out, "mebibytes": taken,
        "cost": float(left @ left), "rows": len(r), "columns": A.shape[1],
    }  # fmt: skip


def main(lengths: list[int]) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.npz"
        write_problem(path)
        print("| length | solver | layout, CPU | step, CPU | memory | chi-square over the least |")
        print("|---|---|---|---|---|---|")
        for length in lengths:
            copies, least = round(length / PIECE), np.inf
            found: dict[str, dict[str, float] | str] = {}
            for name in SOLVERS:
                command = [sys.executable, __file__, "--one", str(path), name, str(copies)]
                try:
                    said = subprocess.run(
                        command, capture_output=True, text=True, timeout=PATIENCE, check=True
                    )
                    found[name] = json.loads(said.stdout.splitlines()[-1])
                    least = min(least, found[name]["cost"])
                except subprocess.TimeoutExpired:
                    found[name] = f"not within {PATIENCE:.0f} s"
                except subprocess.CalledProcessError as error:
                    found[name] = (error.stderr.strip().splitlines() or ["failed"])[-1][:80]
            for name, each in found.items():
                if isinstance(each, str):
                    print(f"| {length} s | {name} | - | {each} | - | - |", flush=True)
                    continue
                print(
                    f"| {length} s, {each['rows']:.0f} rows, {each['columns']:.0f} unknowns | {name} |"
                    f" {each['layout']:.2f} s | {each['step']:.3f} s | {each['mebibytes']:.0f} MiB |"
                    f" {each['cost'] - least:.1e} |",
                    flush=True,
                )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(one(Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]))))
    else:
        main([int(each) for each in sys.argv[1:]] or list(LENGTHS))
