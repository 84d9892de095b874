// What no unbiased estimator of one kernel can beat (T2.5), and the strain filter that follows from it.
#pragma once

#include "client/patient/tissue.h"

namespace teletact::bench {

// Standard deviation (m) of the axial shift of one kernel of one A-line, kernel_m long: the integral form of
// T2.5 (Walker & Trahey 1995, doi 10.1109/58.365243; Carter 1987), var_t >= 1 / (2 T Int_0^inf (2 pi f)^2
// g^2 / (1 - g^2) df), with
// the patient's Gaussian echo spectrum (-6 dB `bandwidth`) and noise that is white within
// center_frequency (1 -+ bandwidth); g = correlation / (1 + N(f) / S(f)).
double displacement_bound_m(const client::Ultrasound&, double kernel_m);

// The flat-band closed form of T2.5.
double flat_displacement_bound_m(const client::Ultrasound&, double kernel_m);

// Kernels that a lateral window of `lines` lines is worth: n^2 over the sum of the squared correlations of
// the speckle between its lines (Gaussian beam of FWHM wavelength x f_number).
double independent_lines(const client::Ultrasound&, double line_pitch_m, int lines);
// Of a window so wide.
double window_lines(const client::Ultrasound&, double window_lateral_m, double line_pitch_m);

// Strain SNR that one kernel allows (Varghese & Ophir 1997, doi 10.1109/58.585212): strain over the standard
// deviation of the least-squares slope over slope_m of displacements of independent kernels; within a kernel
// the strain itself decorrelates (companding avoids it: `companded`), the upper stop band.
double strain_filter(const client::Ultrasound&, double strain, double kernel_m, double slope_m,
                     double independent_kernels, bool companded);

}  // namespace teletact::bench
