"""C code of CasADi functions: what CasADi generates, made fit for a compiler, and loops over batches around it."""

from __future__ import annotations

import re
from collections.abc import Sequence

import casadi as ca

_STACK = 20000  # work vectors up to this many numbers live on the stack
# what CasADi's generator writes: the head of a function, and each read of an input and write of an output
_HEAD = re.compile(r"^static int casadi_f\d+\(const casadi_real\*\* arg, casadi_real\*\* res,[^)]*\) \{", re.MULTILINE)
_INPUT = re.compile(r"\barg\[(\d+)\] ?\? arg\[\1\]\[(\d+)\] : 0(?![.\w])")
_OUTPUT = re.compile(r"\bif \(res\[(\d+)\]!=0\) res\[\1\]\[(\d+)\](?==)")
_HEADER = r"""
#include <stdlib.h>
#ifdef _WIN32
#define PARAOPT_EXPORT __declspec(dllexport)
#else
#define PARAOPT_EXPORT
#endif
"""
# one point, and the loop over a batch: argument k of sample i starts at in[k] + i*in_step[k]
_DRIVER = r"""
static int %(name)s_run(long long n, const double** in, const long long* in_step,
                       double** out, const long long* out_step, casadi_int* iw, double* w) {
  const double* arg[%(sz_arg)d + 1]; double* res[%(sz_res)d + 1]; long long i; int k, flag = 0;
  for (i = 0; i < n && !flag; ++i) {
    for (k = 0; k < %(n_in)d; ++k) arg[k] = in[k] + (in_step ? i*in_step[k] : 0);
    for (k = 0; k < %(n_out)d; ++k) res[k] = out[k] + (out_step ? i*out_step[k] : 0);
    flag = %(name)s(arg, res, iw, w, 0);
  }
  return flag;
}
PARAOPT_EXPORT int %(name)s_batch(long long n, const double** in, const long long* in_step,
                                  double** out, const long long* out_step) {
  int flag = -1;
#if %(on_stack)d
  casadi_int iw[%(sz_iw)d + 1]; double w[%(sz_w)d + 1];
  flag = %(name)s_run(n, in, in_step, out, out_step, iw, w);
#else
  casadi_int* iw = (casadi_int*) malloc((%(sz_iw)d + 1)*sizeof(casadi_int));
  double* w = (double*) malloc((%(sz_w)d + 1)*sizeof(double));
  if (iw && w) flag = %(name)s_run(n, in, in_step, out, out_step, iw, w);
  free(iw); free(w);
#endif
  return flag;
}
PARAOPT_EXPORT int %(name)s_point(void** buffers) {
  return %(name)s_batch(1, (const double**) buffers[0], 0, (double**) buffers[1], 0);
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
        on_stack = int(sizes["sz_w"] + sizes["sz_iw"] <= _STACK)
        drivers.append(_DRIVER % {"name": function.name(), "on_stack": on_stack, **sizes})
    return _straighten(generator.dump()) + _HEADER + "".join(drivers)


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
