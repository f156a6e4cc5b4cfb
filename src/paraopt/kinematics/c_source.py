"""C code of CasADi functions: what CasADi generates, made fit for a compiler, and loops over batches around it."""

from __future__ import annotations

import re
from collections.abc import Sequence

import casadi as ca

from paraopt.errors import BackendError

_STACK = 20000  # work vectors up to this many numbers live on the stack
# what CasADi's generator writes: the head of a function, and each read of an input and write of an output
_HEAD = re.compile(r"^static int casadi_f\d+\(const casadi_real\*\* arg, casadi_real\*\* res,[^)]*\) \{", re.MULTILINE)
_INPUT = re.compile(r"\barg\[(\d+)\] ?\? arg\[\1\]\[(\d+)\] : 0(?![.\w])")
_OUTPUT = re.compile(r"\bif \(res\[(\d+)\]!=0\) res\[\1\]\[(\d+)\](?==)")
_CALL = re.compile(r"\b([A-Za-z_]\w*)\(")
_LOCAL = re.compile(r"\ba(\d+)\b")
_LOCALS = re.compile(r"^  lanes a\d+[,;]")
_DECLARATION = re.compile(r"^  (?:static )?(?:const )?lanes\*? ")
_PART = 2000  # statements of one compiled piece
_COMPARISON = re.compile(r"[<>?!&|]|==")
_CONSTANT = re.compile(r"\b((?:[aw]\d+|w\[\d+\]|res\d+_\[\d+\]))=(-?[0-9.]+(?:e[-+]?\d+)?);")
_HEADER = r"""
#include <stdlib.h>
#ifdef _WIN32
#define PARAOPT_EXPORT __declspec(dllexport)
#else
#define PARAOPT_EXPORT
#endif
"""
# one point, and the loop over a batch: argument k of sample i starts at in[k] + i*in_step[k]; of an output that is not
# full the entries are computed side by side and then written to their places, and its zeros are left alone
_DRIVER = r"""
%(tables)s
static int %(name)s_run(long long n, const double** in, const long long* in_step,
                       double** out, const long long* out_step, casadi_int* iw, double* w, double* nz) {
  const double* arg[%(sz_arg)d + 1]; double* res[%(sz_res)d + 1]; long long i; int k, flag = 0;
  for (i = 0; i < n && !flag; ++i) {
    for (k = 0; k < %(n_in)d; ++k) arg[k] = in[k] + (in_step ? i*in_step[k] : 0);
    for (k = 0; k < %(n_out)d; ++k)
      res[k] = %(name)s_at[k] ? nz + %(name)s_first[k] : out[k] + (out_step ? i*out_step[k] : 0);
    flag = %(name)s(arg, res, iw, w, 0);
    for (k = 0; k < %(n_out)d && !flag; ++k) {
      const int* at = %(name)s_at[k]; const double* from = nz + %(name)s_first[k];
      double* to = out[k] + (out_step ? i*out_step[k] : 0); int j, count;
      if (!at) continue;
      count = %(name)s_first[k+1] - %(name)s_first[k];
      for (j = 0; j < count; ++j) to[at[j]] = from[j];
    }
  }
  return flag;
}
PARAOPT_EXPORT int %(name)s_batch(long long n, const double** in, const long long* in_step,
                                  double** out, const long long* out_step) {
  int flag = -1;
#if %(on_stack)d
  casadi_int iw[%(sz_iw)d + 1]; double w[%(sz_w)d + 1], nz[%(nnz)d + 1];
  flag = %(name)s_run(n, in, in_step, out, out_step, iw, w, nz);
#else
  casadi_int* iw = (casadi_int*) malloc((%(sz_iw)d + 1)*sizeof(casadi_int));
  double* w = (double*) malloc((%(sz_w)d + 1)*sizeof(double));
  double* nz = (double*) malloc((%(nnz)d + 1)*sizeof(double));
  if (iw && w && nz) flag = %(name)s_run(n, in, in_step, out, out_step, iw, w, nz);
  free(iw); free(w); free(nz);
#endif
  return flag;
}
PARAOPT_EXPORT int %(name)s_point(void** buffers) {
  return %(name)s_batch(1, (const double**) buffers[0], 0, (double**) buffers[1], 0);
}
"""
# Damped Newton for one sample after the other, several at a time: each lane of a vector holds one. Its course is that
# of `solve_closure`; what opens the loops at a point (sines and cosines) is called lane by lane, and the linear solve,
# which costs several times more, once for all lanes. Only the four operations act on vectors: lanes do not see each
# other, and a result does not depend on who sits beside.
_NEWTON_HEAD = r"""
#include <math.h>
#include <string.h>
#if defined(__AVX2__)
#define LANES 4
#elif defined(__GNUC__) || defined(__clang__)
#define LANES 2
#endif
typedef double lanes __attribute__((vector_size(8*LANES)));
#define ALL_LANES(value) ((lanes) {0} + (value))
static inline lanes lanes_sq(lanes x) { return x*x; }
"""
_NEWTON = r"""
#define N %(n)d
#define N_ROWS %(n_rows)d
#define N_ENTRIES %(n_entries)d
typedef struct {
  lanes entries[N_ENTRIES + 1], f[N_ROWS + 1], free[N + 1], damping[1], y[N + 1], w[%(lanes_w)d + 1];
  double opened[N_ROWS + 1], E[N_ENTRIES + 1], w_open[%(sz_w)d + 1], trial[N + 1], step[LANES][N + 1];
  double residual[LANES], damp[LANES];
  long long sample[LANES], count[LANES];
  int waits[LANES];
  casadi_int iw[%(sz_iw)d + 1];
} Work;

/* the largest absolute value; NaN when there is one */
static double largest(const double* v, int n) {
  double most = 0; int k;
  for (k = 0; k < n; ++k) {
    double size = fabs(v[k]);
    if (size != size) return size;
    if (size > most) most = size;
  }
  return most;
}

/* room: free, options, the starts, which become the best points, and their residuals and numbers of iterations */
static int run(Work* s, long long n, double* room) {
  const double *free_ = room, *options = room + N;
  double *best = room + N + 4, *residual = best + n*N, *count = residual + n;
  const double tolerance = options[0], iterations = options[1], damping = options[2], limit = options[3];
  const lanes* arg[5] = {s->entries, s->f, s->free, s->damping, 0};
  lanes* res[2] = {s->y, 0};
  long long next = 0;
  int lane, k, waiting;
  memset(s, 0, sizeof(*s));
  for (k = 0; k < N; ++k) s->free[k] = ALL_LANES(free_[k]);
  s->damping[0] = ALL_LANES(1.0);
  for (lane = 0; lane < LANES; ++lane) s->sample[lane] = -1;
  do {
    waiting = 0;
    for (lane = 0; lane < LANES; ++lane) {
      double* step = s->step[lane];
      s->waits[lane] = 0;
      while (!s->waits[lane]) {
        double now, *x;
        const double* arg_open[2]; double* res_open[3];
        if (s->sample[lane] < 0) { /* take the next sample */
          if (next == n) break;
          x = best + next*N;
          residual[next] = INFINITY; count[next] = 0;
          for (k = 0; k < N && isfinite(x[k]); ++k) step[k] = 0;
          if (k == N) {
            s->sample[lane] = next; s->count[lane] = 0; s->damp[lane] = damping; s->residual[lane] = INFINITY;
          }
          ++next;
          continue;
        }
        if (s->count[lane] >= iterations) { s->sample[lane] = -1; continue; }
        x = best + s->sample[lane]*N;
        for (k = 0; k < N; ++k) s->trial[k] = x[k] + step[k];
        arg_open[0] = s->trial; res_open[0] = s->opened; res_open[1] = s->E;
        if (%(open)s(arg_open, res_open, s->iw, s->w_open, 0)) return 1;
        count[s->sample[lane]] = (double) ++s->count[lane];
        now = largest(s->opened, N_ROWS);
        if (now < s->residual[lane]) {
          memcpy(x, s->trial, N*sizeof(double));
          s->residual[lane] = residual[s->sample[lane]] = now;
          if (now <= tolerance) { s->sample[lane] = -1; continue; }
          for (k = 0; k < N_ROWS; ++k) s->f[k][lane] = s->opened[k];
          for (k = 0; k < N_ENTRIES; ++k) s->entries[k][lane] = s->E[k];
          s->damping[0][lane] = s->damp[lane];
          s->damp[lane] = fmax(0.1*s->damp[lane], 1e-14);
          s->waits[lane] = 1;
          ++waiting;
        } else { /* the step was too bold, or round-off is reached */
          s->damp[lane] = fmax(30.0*s->damp[lane], 1e-8);
          for (k = 0; k < N; ++k) { step[k] *= 0.25; s->trial[k] = step[k] / scale_[k]; }
          if (largest(s->trial, N) < 1e-15) s->sample[lane] = -1;
        }
      }
    }
    if (waiting) {
      if (lanes_correct(arg, res, s->iw, s->w, 0)) return 1;
      for (lane = 0; lane < LANES; ++lane) if (s->waits[lane]) {
        double size, factor, *step = s->step[lane];
        for (k = 0; k < N; ++k) step[k] = s->y[k][lane];
        size = largest(step, N);
        factor = limit / fmax(size, 1e-300);
        if (size != size || factor > 1.0) factor = 1.0;
        for (k = 0; k < N; ++k) step[k] *= factor * scale_[k];
        if (size * factor < 1e-15) s->sample[lane] = -1;
      }
    }
  } while (waiting);
  return 0;
}

PARAOPT_EXPORT int %(name)s_batch(long long n, double* data) {
  /* vectors want to lie at multiples of their size */
  char* room = (char*) malloc(sizeof(Work) + sizeof(lanes));
  int flag = -1;
  if (room) flag = run((Work*) (room + sizeof(lanes) - (size_t) room %% sizeof(lanes)), n, data);
  free(room);
  return flag;
}
"""


def generate_source(functions: Sequence[ca.Function]) -> str:
    """Write C code that exports `<name>_batch` and `<name>_point` for each function.

    Args:
        functions: Functions of different names; all their outputs are wanted at every call.

    Returns:
        The text of one file, to be compiled into a shared library.
    """
    generator = ca.CodeGenerator("functions.c")
    for function in functions:
        generator.add(function)
    drivers = []
    for function in functions:
        sizes = {key: getattr(function, key)() for key in ("n_in", "n_out", "sz_arg", "sz_res", "sz_iw", "sz_w")}
        tables, nnz = _write_tables(function)
        on_stack = int(sizes["sz_w"] + sizes["sz_iw"] + nnz <= _STACK)
        drivers.append(_DRIVER % {"name": function.name(), "on_stack": on_stack, "tables": tables, "nnz": nnz, **sizes})
    return _straighten(generator.dump()) + _HEADER + "".join(drivers)


def _write_tables(function: ca.Function) -> tuple[str, int]:
    """Write the tables that tell where each non-zero entry goes in the full, row-major output; full outputs need none.

    Args:
        function: A function whose outputs are transposed: their columns are the rows that are wanted.

    Returns:
        The C text, and the number of entries of the outputs that are not full.
    """
    name, lines, names, first = function.name(), [], [], [0]
    for k in range(function.n_out()):
        pattern = function.sparsity_out(k)
        full = pattern.is_dense()
        names.append("0" if full else f"{name}_at{k}")
        first.append(first[-1] + (0 if full else pattern.nnz()))
        if not full:
            rows, columns = pattern.get_triplet()
            at = [c * pattern.size1() + r for r, c in zip(rows, columns, strict=True)] or [0]
            lines.append(f"static const int {name}_at{k}[] = {{{', '.join(map(str, at))}}};")
    lines.append(f"static const int* const {name}_at[] = {{{', '.join([*names, '0'])}}};")
    lines.append(f"static const int {name}_first[] = {{{', '.join(map(str, first))}}};")
    return "\n".join(lines), first[-1]


def generate_newton(opening: ca.Function, correcting: ca.Function, scale: Sequence[float], name: str) -> str:
    """Write C code that exports `<name>_batch`, the damped Newton iteration on a batch.

    Args:
        opening: X to the scaled residual and the entries of its Jacobian.
        correcting: (entries, residual, free, damping) to a scaled step, by the four operations alone.
        scale: Scale of each variable [m or rad].
        name: Name of the loop.

    Returns:
        The text of one file, to be compiled into a shared library.

    Raises:
        BackendError: The correcting function needs more than the four operations.
    """
    generator = ca.CodeGenerator("functions.c")
    generator.add(opening)
    sizes = {
        "name": name, "open": opening.name(), "n": opening.numel_in(0), "n_rows": opening.numel_out(0),
        "n_entries": opening.numel_out(1), "lanes_w": correcting.sz_w(), "sz_w": opening.sz_w(),
        "sz_iw": max(opening.sz_iw(), correcting.sz_iw()),
    }  # fmt: skip
    scales = f"static const double scale_[] = {{{', '.join(f'{s!r}' for s in map(float, scale))}}};\n"
    return "".join(
        [_straighten(generator.dump()), _HEADER, _NEWTON_HEAD, _spread(correcting, "lanes_correct"), scales,
         _NEWTON % sizes]
    )  # fmt: skip


def _spread(function: ca.Function, name: str) -> str:
    """Write a function of the four operations for vectors in place of numbers."""
    generator = ca.CodeGenerator("functions.c")
    generator.add(function)
    code = _straighten(generator.dump())
    begin = next(_HEAD.finditer(code)).start()
    body = code[begin : code.index("\n}\n", begin) + 3]
    body = re.sub(r"^static int casadi_f\d+", f"static int {name}", body).replace("casadi_sq(", "lanes_sq(")
    body = _CONSTANT.sub(r"\1=ALL_LANES(\2);", body.replace("casadi_real", "lanes"))
    work = [line for line in body.splitlines()[1:] if not _DECLARATION.match(line)]
    strange = {word for line in work for word in (*_CALL.findall(line), *_COMPARISON.findall(line))}
    if strange - {"lanes_sq", "ALL_LANES"}:
        raise BackendError(f"{function.name()} uses {sorted(strange)}; vectors know the four operations only")
    return body if len(work) <= _PART else _cut(body, work, name)


def _cut(body: str, work: Sequence[str], name: str) -> str:
    """Cut a long function into parts that share an array: compilers take the square of its length."""
    heads = [line for line in body.splitlines()[1:] if _DECLARATION.match(line) and not _LOCALS.match(line)]
    statements = [line for line in work if "=" in line]
    count = 1 + max(int(k) for line in statements for k in _LOCAL.findall(line))
    given = sorted(set(re.findall(r"\barg\d+_|\bres\d+_", " ".join(statements))))
    taken = ", ".join(["lanes* v", "lanes* w", *[f"{'const ' * (g < 'res')}lanes* {g}" for g in given]])
    parts, calls = [], []
    for k in range(0, len(statements), _PART):
        lines = "\n".join(_LOCAL.sub(lambda m: f"v[{int(m[1])}]", line) for line in statements[k : k + _PART])
        parts.append(f"static void {name}_{k}({taken}) {{\n{lines}\n}}\n")
        calls.append(f"  {name}_{k}({', '.join(['v', 'w', *given])});")
    head = body.splitlines()[0]
    return "\n".join([*parts, head, *heads, f"  lanes v[{count}];", *calls, "  return 0;", "}", ""])


def _straighten(code: str) -> str:
    """Take the branches out of generated functions, so that the compiler sees them as one block.

    CasADi asks at every number whether its array is there, `if (res[0]!=0) res[0][5]=a1;`, and compilers then call sine
    and cosine of one angle apart. Here absent arrays are replaced at the head of the function: inputs by zeros, outputs
    by an array that nobody reads.
    """
    heads = list(_HEAD.finditer(code))
    pieces, done = [], 0
    for head, end in zip(heads, [*(h.start() for h in heads[1:]), len(code)], strict=True):
        body, lines = code[head.end() : end], []
        for name, kind, pattern, stand_in, value in (
            ("arg", "const casadi_real", _INPUT, "static const casadi_real zeros_", "={0}"),
            ("res", "casadi_real", _OUTPUT, "casadi_real unread_", ""),
        ):
            found = [(int(k), int(i)) for k, i in pattern.findall(body)]
            size = 1 + max((i for _, i in found), default=-1)
            if not 0 < size <= _STACK:
                continue
            body = pattern.sub(rf"{name}\1_[\2]", body)
            lines.append(f"{stand_in}[{size}]{value};")
            instead = stand_in.split()[-1]
            lines += [
                f"{kind}* {name}{k}_={name}[{k}]? {name}[{k}] : {instead};" for k in sorted({k for k, _ in found})
            ]
        pieces += [code[done : head.end()], "".join(f"\n  {line}" for line in lines), body]
        done = end
    return "".join([*pieces, code[done:]])
