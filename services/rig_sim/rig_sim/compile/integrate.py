"""The player's loop: classical Runge-Kutta of order 4 with a fixed step, as LLVM IR.

It stands in the same module as the model it integrates: no second compiler, no cache on disk, no Python in the loop.
Calling it through ctypes releases the GIL.

Two functions of the model are expected, both of ``n`` states and ``n_u`` inputs::

    void derivative(const double *state, const double *inputs, double *derivative)
    void observe   (const double *state, const double *inputs, double *derivative, double *outputs)

``observe`` is the first stage of the first step after each sample instant, so that outputs cost one evaluation less and
are computed once a sample. The loop's own function is::

    int64 play(double *state, const double *commands, int64 command_stride, double *outputs, int64 output_stride,
               int64 samples, int64 substeps, double step, int64 ahead, const double *bounds)
"""

import ctypes
from enum import Enum

COMPLETED = -1
PLAY_SIGNATURE = ctypes.CFUNCTYPE(
    ctypes.c_int64,
    *(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64),
    *(ctypes.c_int64, ctypes.c_int64, ctypes.c_double, ctypes.c_int64, ctypes.c_void_p),
)


class Interpolation(Enum):
    """What the command is between two samples."""

    LINEAR = "linear"
    ZERO_ORDER_HOLD = "zero_order_hold"

    @property
    def ahead(self) -> int:
        """How many samples the command looks ahead: 1 or 0."""
        return 1 if self is Interpolation.LINEAR else 0


def play_text(*, states: int, inputs: int, outputs: int) -> str:
    """Write the loop for a model of these sizes."""
    return "\n".join(
        [
            _elementwise(
                "interpolate",
                "ptr noalias %commands, i64 %stride, i64 %now, i64 %next, double %fraction, ptr noalias %inputs",
                count=inputs,
                body="""
  %row = mul i64 %i, %stride
  %at.now = add i64 %row, %now
  %at.next = add i64 %row, %next
  %p.now = getelementptr double, ptr %commands, i64 %at.now
  %p.next = getelementptr double, ptr %commands, i64 %at.next
  %v.now = load double, ptr %p.now
  %v.next = load double, ptr %p.next
  %rise = fsub double %v.next, %v.now
  %part = fmul double %rise, %fraction
  %value = fadd double %v.now, %part
  %p = getelementptr double, ptr %inputs, i64 %i
  store double %value, ptr %p""",
            ),
            _elementwise(
                "scatter",
                "ptr noalias %row, ptr noalias %outputs, i64 %stride, i64 %sample",
                count=outputs,
                body="""
  %p = getelementptr double, ptr %row, i64 %i
  %value = load double, ptr %p
  %begin = mul i64 %i, %stride
  %at = add i64 %begin, %sample
  %q = getelementptr double, ptr %outputs, i64 %at
  store double %value, ptr %q""",
            ),
            _elementwise(
                "advance",  # moved = start + factor * slope
                "ptr %start, ptr noalias %slope, double %factor, ptr %moved",
                count=states,
                body="""
  %p = getelementptr double, ptr %start, i64 %i
  %q = getelementptr double, ptr %slope, i64 %i
  %r = getelementptr double, ptr %moved, i64 %i
  %value = load double, ptr %p
  %rate = load double, ptr %q
  %change = fmul contract double %rate, %factor
  %new = fadd contract double %value, %change
  store double %new, ptr %r""",
            ),
            _WITHIN.format(states=states),
            _PLAY.format(states=states, inputs=max(inputs, 1), outputs=max(outputs, 1)),
        ]
    )


def _elementwise(name: str, parameters: str, *, count: int, body: str) -> str:
    head = f"define internal void @{name}({parameters}) alwaysinline nounwind {{"
    if count == 0:
        return f"{head}\n  ret void\n}}"
    return f"""{head}
entry:
  br label %loop
loop:
  %i = phi i64 [0, %entry], [%i.next, %loop]
{body}
  %i.next = add i64 %i, 1
  %again = icmp slt i64 %i.next, {count}
  br i1 %again, label %loop, label %end
end:
  ret void
}}"""


# Ordered comparison: a NaN is outside every bound.
_WITHIN = """
define internal i1 @within(ptr noalias %state, ptr noalias %bounds) alwaysinline nounwind {{
entry:
  br label %loop
loop:
  %i = phi i64 [0, %entry], [%i.next, %loop]
  %so.far = phi i1 [true, %entry], [%inside, %loop]
  %p = getelementptr double, ptr %state, i64 %i
  %q = getelementptr double, ptr %bounds, i64 %i
  %value = load double, ptr %p
  %bound = load double, ptr %q
  %magnitude = call double @llvm.fabs.f64(double %value)
  %this = fcmp ole double %magnitude, %bound
  %inside = and i1 %so.far, %this
  %i.next = add i64 %i, 1
  %again = icmp slt i64 %i.next, {states}
  br i1 %again, label %loop, label %end
end:
  ret i1 %inside
}}"""

# The slopes are summed as (k1 + 2 k2 + 2 k3 + k4) h/6. Fractions of the sample are formed from the substep's number,
# not accumulated: nothing but the state is carried from sample to sample, so chunks give the bits of one long call.
_PLAY = """
define i64 @play(ptr noalias %state, ptr noalias %commands, i64 %command.stride, ptr noalias %outputs,
                 i64 %output.stride, i64 %samples, i64 %substeps, double %step, i64 %ahead,
                 ptr noalias %bounds) nounwind {{
entry:
  %point = alloca [{states} x double], align 64
  %slope = alloca [{states} x double], align 64
  %sum = alloca [{states} x double], align 64
  %inputs = alloca [{inputs} x double], align 64
  %row = alloca [{outputs} x double], align 64
  %half.step = fmul double %step, 0.5
  %sixth.step = fdiv double %step, 6.0
  %parts = sitofp i64 %substeps to double
  br label %sample
sample:
  %k = phi i64 [0, %entry], [%k.next, %sample.end]
  %inside = call i1 @within(ptr %state, ptr %bounds)
  br i1 %inside, label %sound, label %diverged
diverged:
  ret i64 %k
sound:
  %more = icmp slt i64 %k, %samples
  br i1 %more, label %observed, label %completed
completed:
  ret i64 -1
observed:
  %k.ahead = add i64 %k, %ahead
  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.ahead, double 0.0, ptr %inputs)
  call void @observe(ptr %state, ptr %inputs, ptr %sum, ptr %row)
  call void @scatter(ptr %row, ptr %outputs, i64 %output.stride, i64 %k)
  br label %stages
first.stage:
  %begin = fdiv double %number.next, %parts
  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.ahead, double %begin, ptr %inputs)
  call void @derivative(ptr %state, ptr %inputs, ptr %sum)
  br label %stages
stages:
  %j = phi i64 [0, %observed], [%j.next, %first.stage]
  %number = sitofp i64 %j to double
  %number.middle = fadd double %number, 0.5
  %number.next = fadd double %number, 1.0
  %middle = fdiv double %number.middle, %parts
  %end = fdiv double %number.next, %parts
  call void @advance(ptr %state, ptr %sum, double %half.step, ptr %point)
  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.ahead, double %middle, ptr %inputs)
  call void @derivative(ptr %point, ptr %inputs, ptr %slope)
  call void @advance(ptr %sum, ptr %slope, double 2.0, ptr %sum)
  call void @advance(ptr %state, ptr %slope, double %half.step, ptr %point)
  call void @derivative(ptr %point, ptr %inputs, ptr %slope)
  call void @advance(ptr %sum, ptr %slope, double 2.0, ptr %sum)
  call void @advance(ptr %state, ptr %slope, double %step, ptr %point)
  call void @interpolate(ptr %commands, i64 %command.stride, i64 %k, i64 %k.ahead, double %end, ptr %inputs)
  call void @derivative(ptr %point, ptr %inputs, ptr %slope)
  call void @advance(ptr %sum, ptr %slope, double 1.0, ptr %sum)
  call void @advance(ptr %state, ptr %sum, double %sixth.step, ptr %state)
  %j.next = add i64 %j, 1
  %again = icmp slt i64 %j.next, %substeps
  br i1 %again, label %first.stage, label %sample.end
sample.end:
  %k.next = add i64 %k, 1
  br label %sample
}}"""
