#include "client/patient/patient.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <numbers>

namespace teletact::client {
namespace {

Tissue small_tissue() {
  Tissue t;
  t.width_m = .12;
  t.depth_m = .03;
  t.inclusions = {{.055, .011, .011, 6}, {.09, .017, .009, 3}};
  t.probe.width_m = .04;
  return t;
}

TEST(PatientElement, StoresEnergyOfStrainNotOfRigidMotion) {
  const double dx = 5e-4, dy = 7e-4, nu = .49, mu = 1 / (2 * (1 + nu)),
               lambda = nu / ((1 + nu) * (1 - 2 * nu));
  const auto k = element_stiffness(dx, dy, nu);
  const Eigen::Map<const Eigen::Matrix<double, 8, 8, Eigen::RowMajor>> matrix(k.data());
  EXPECT_LE((matrix - matrix.transpose()).cwiseAbs().maxCoeff(), 1e-12);
  const auto energy = [&](double exx, double eyy, double uxy, double uyx, double tx, double ty) {
    Eigen::Matrix<double, 8, 1> u;
    for (int n = 0; n < 4; ++n) {
      const double x = n % 2 * dx, y = n / 2 * dy;
      u(2 * n) = tx + exx * x + uxy * y;
      u(2 * n + 1) = ty + eyy * y + uyx * x;
    }
    return .5 * u.dot(matrix * u);
  };
  const auto exact = [&](double exx, double eyy, double exy) {
    return dx * dy * (mu * (exx * exx + eyy * eyy + 2 * exy * exy) + .5 * lambda * (exx + eyy) * (exx + eyy));
  };
  EXPECT_NEAR(energy(0, 0, 0, 0, .3, -.2), 0, 1e-12);
  EXPECT_NEAR(energy(0, 0, 1, -1, 0, 0), 0, 1e-18) << "rotation";
  EXPECT_NEAR(energy(1, 0, 0, 0, .1, 0) / exact(1, 0, 0), 1, 1e-9);
  EXPECT_NEAR(energy(.3, -.7, .2, .4, 0, 0) / exact(.3, -.7, .3), 1, 1e-9);
}

// The block elimination against the whole matrix, assembled and solved densely.
TEST(ColumnSolver, SolvesWhatTheAssembledMatrixSays) {
  Tissue t = small_tissue();
  t.width_m = .011, t.depth_m = .005, t.probe.width_m = .004, t.probe.compression_m = 1e-4;
  t.inclusions = {{.004, .002, .003, 40}};
  const PatientMesh mesh = make_mesh(t, .001);
  const std::size_t nx = mesh.nx(), ny = mesh.ny();
  const auto n = static_cast<Eigen::Index>(2 * nx * (ny - 1));
  Eigen::MatrixXd k = Eigen::MatrixXd::Zero(n, n);
  for (std::size_t i = 0; i + 1 < nx; ++i)
    for (std::size_t j = 0; j + 1 < ny; ++j) {
      const auto e =
          element_stiffness(mesh.x_m[i + 1] - mesh.x_m[i], mesh.y_m[j + 1] - mesh.y_m[j], t.poisson_ratio);
      for (std::size_t a = 0; a < 8; ++a)
        for (std::size_t b = 0; b < 8; ++b) {
          const std::size_t ja = j + a / 4, jb = j + b / 4;
          if (ja == ny - 1 || jb == ny - 1) continue;
          const auto r = 2 * ((i + a / 2 % 2) * (ny - 1) + ja) + a % 2,
                     c = 2 * ((i + b / 2 % 2) * (ny - 1) + jb) + b % 2;
          k(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) += mesh.modulus(i, j) * e[8 * a + b];
        }
    }
  const ColumnSolver solver(mesh);
  const Eigen::MatrixXd s = solver.surface_compliance();
  const auto surface = [&](std::size_t i) { return static_cast<Eigen::Index>(2 * i * (ny - 1) + 1); };
  const Eigen::MatrixXd inverse = k.llt().solve(Eigen::MatrixXd::Identity(n, n));
  double worst = 0, scale = 0;
  for (std::size_t i = 0; i < nx; ++i)
    for (std::size_t m = 0; m < nx; ++m) {
      const double expected = inverse(surface(i), surface(m));
      worst =
          std::max(worst, std::abs(s(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(m)) - expected));
      scale = std::max(scale, std::abs(expected));
    }
  EXPECT_LE(worst, 1e-10 * scale);
  Eigen::VectorXd f = Eigen::VectorXd::LinSpaced(static_cast<Eigen::Index>(nx), -1, 2),
                  load = Eigen::VectorXd::Zero(n);
  for (std::size_t i = 0; i < nx; ++i) load(surface(i)) = f(static_cast<Eigen::Index>(i));
  const Eigen::VectorXd expected = inverse * load;
  const auto u = solver.displacement(f);
  double error = 0;
  for (std::size_t i = 0; i < nx; ++i)
    for (std::size_t d = 0; d < 2 * ny; ++d) {
      const double value = d < 2 * (ny - 1) ? expected(static_cast<Eigen::Index>(2 * i * (ny - 1) + d)) : 0;
      error = std::max(error, std::abs(u[2 * ny * i + d] - value));
    }
  EXPECT_LE(error, 1e-10 * expected.cwiseAbs().maxCoeff());
}

// nu = 0: pressing the whole surface is one-dimensional, whatever the bonded bottom: u_y = w (1 - y / depth),
// force = E w / depth x width x elevation.
TEST(Press, UniformCompressionIsExactWithoutPoisson) {
  Tissue t;
  t.width_m = .05, t.depth_m = .03, t.poisson_ratio = 0;
  t.probe.width_m = t.width_m;
  const Patient patient(t);
  const ProbeState state = patient.press(0, 3e-4);
  EXPECT_NEAR(state.force_n, t.youngs_modulus_pa * 3e-4 / .03 * .05 * t.probe.elevation_m, 1e-9);
  for (const double y : {0.0, .0003, .01, .0271, .03})
    for (const double x : {0.0, .0201, .05}) {
      EXPECT_NEAR(state.field->at(x, y).y, 3e-4 * (1 - y / .03), 1e-13);
      EXPECT_NEAR(state.field->at(x, y).x, 0, 1e-13);
    }
}

// Confined sides are what an infinitely wide probe makes in its middle: u_x = 0 there, so with nu > 0 the
// stress is the oedometric E (1 - nu) / ((1 + nu)(1 - 2 nu)) x strain.
TEST(Press, MiddleOfAWideProbeIsOedometric) {
  Tissue t;
  t.width_m = .2, t.depth_m = .01, t.poisson_ratio = .3;
  t.probe.width_m = t.width_m;
  const Patient patient(t);
  const ProbeState state = patient.press(0, 1e-4);
  for (const double y : {.001, .005, .0085})
    EXPECT_NEAR(state.field->at(.1, y).y, 1e-4 * (1 - y / .01), 1e-8) << y;
  const double oedometric = t.youngs_modulus_pa * .7 / (1.3 * .4);
  const double whole = oedometric * .01 * t.width_m * t.probe.elevation_m;
  EXPECT_LT(state.force_n, whole) << "its free sides are softer";
  EXPECT_NEAR(state.force_n / whole, 1, .04);
}

TEST(Press, MovesTheFaceByTheCompressionAndKeepsTheBottom) {
  const Patient patient(small_tissue());
  const ProbeState state = patient.press(.03, 3e-4);
  for (double x = .03; x <= .07; x += .0013) {
    EXPECT_NEAR(state.field->at(x, 0).y, 3e-4, 1e-12) << x;
    EXPECT_EQ(state.field->at(x, .03).y, 0);
  }
  EXPECT_LT(state.field->at(.02, 0).y, 2e-4);
  EXPECT_GT(state.force_n, 0);
  EXPECT_DOUBLE_EQ(state.contact_area_m2, .04 * .01);
  EXPECT_NEAR(patient.press(.03, 1e-4).force_n * 3, state.force_n, 1e-9) << "linear";
}

TEST(SensedForce, HasTheSensorsGainAndZero) {
  Probe probe;
  probe.force_noise_relative = 0, probe.force_noise_n = 0;
  EXPECT_EQ(sensed_force(probe, .3, 1), .3);
  probe.force_gain_error = .03, probe.force_zero_n = -.005;
  EXPECT_NEAR(sensed_force(probe, .3, 1), .3 * 1.03 - .005, 1e-12);
}

TEST(Press, ForceConvergesUnderRefinement) {
  double force[3];
  const double spacing[3] = {.001, .0005, .00025};
  for (int k = 0; k < 3; ++k) force[k] = Patient(small_tissue(), spacing[k]).press(.035, 3e-4).force_n;
  const double first = force[0] - force[1], second = force[1] - force[2];
  EXPECT_LE(std::abs(second), .65 * std::abs(first)) << force[0] << " " << force[1] << " " << force[2];
  EXPECT_LE(std::abs(second / force[2]), .01) << "half a millimetre is within 1 % of a quarter";
}

TEST(Press, RefusesWhatItCannotDo) {
  const Patient patient(small_tissue());
  EXPECT_THROW(patient.press(-.01, 1e-4), std::invalid_argument);
  EXPECT_THROW(patient.press(.081, 1e-4), std::invalid_argument);
  EXPECT_THROW(patient.press(.01, 0), std::invalid_argument);
  EXPECT_THROW(patient.press(.01, .02), std::invalid_argument);
  EXPECT_THROW(patient.press(std::numeric_limits<double>::quiet_NaN(), 1e-4), std::invalid_argument);
  Tissue bad = small_tissue();
  bad.poisson_ratio = .5;
  EXPECT_THROW(Patient{bad}, TissueError);
  Tissue vast = small_tissue();
  vast.width_m = 2, vast.depth_m = .3;
  EXPECT_THROW(Patient{vast}, TissueError) << "before it is allocated";
}

const std::vector<Finger> kFingers{{FingerShape::kRoundedTip, .008, .004, 0},
                                   {FingerShape::kRoundedTip, .003, .004, 0},
                                   {FingerShape::kFlatPunch, .001, .004, 0},
                                   {FingerShape::kNode, .008, .004, .0008}};

TEST(Touch, ForceIsGradientOfEnergy) {
  const Patient patient(small_tissue());
  for (const Finger& finger : kFingers)
    for (const double x : {.0313, .0507, .0571, .07}) {
      const double depth = .0023, step = 1e-7;
      const auto u = [&](double dx, double dd) { return patient.touch(finger, x + dx, depth + dd).energy_j; };
      const TouchForce f = patient.touch(finger, x, depth);
      const double scale = std::abs(f.force_n[1]);
      EXPECT_LT(f.force_n[1], 0);
      EXPECT_NEAR(f.force_n[0], -(u(step, 0) - u(-step, 0)) / (2 * step), 2e-5 * scale) << x;
      EXPECT_NEAR(f.force_n[1], -(u(0, step) - u(0, -step)) / (2 * step), 2e-5 * scale) << x;
    }
}

// The same program by projected Gauss-Seidel: p_i <- max(0, p_i - (S p - w)_i / S_ii).
TEST(Touch, SolvesTheUnilateralProgram) {
  const Patient patient(small_tissue());
  const double x = .0513, depth = .003, radius = .008;
  std::vector<Eigen::Index> near;
  for (std::size_t i = 0; i < patient.mesh().nx(); ++i)
    if (std::abs(patient.mesh().x_m[i] - x) < .012) near.push_back(static_cast<Eigen::Index>(i));
  const Eigen::MatrixXd s = patient.surface_compliance()(near, near);
  const auto n = static_cast<Eigen::Index>(near.size());
  Eigen::VectorXd w(n), p = Eigen::VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double d = patient.mesh().x_m[static_cast<std::size_t>(near[static_cast<std::size_t>(i)])] - x;
    w(i) = depth - d * d / (2 * radius);
  }
  for (int sweep = 0; sweep < 20000; ++sweep)
    for (Eigen::Index i = 0; i < n; ++i) p(i) = std::max(0.0, p(i) - (s.row(i).dot(p) - w(i)) / s(i, i));
  const TouchForce f = patient.touch({FingerShape::kRoundedTip, radius, 0, 0}, x, depth);
  EXPECT_NEAR(f.force_n[1] / (-p.sum() * .01), 1, 1e-6);
  EXPECT_EQ(f.contact_nodes, static_cast<std::size_t>((p.array() > 0).count()));
  EXPECT_LT(f.contact_width_m, 2 * std::sqrt(2 * radius * depth)) << "the tip's flanks do not touch";
}

// Hertz line contact: P = pi E* a^2 / (4 R) per metre, a the half-width (Johnson 1985, eq. 4.43), local and
// thus true of a layer that is deep against a. The border of a discrete contact is first order in the
// spacing: two spacings are extrapolated, each averaged over depths since a is known to half a spacing only.
TEST(Touch, SmallContactIsHertzian) {
  Tissue t;
  t.width_m = .04, t.depth_m = .04, t.probe.width_m = .02;
  const double radius = .02, effective = t.youngs_modulus_pa / (1 - t.poisson_ratio * t.poisson_ratio);
  const auto mean_ratio = [&](double spacing) {
    const Patient patient(t, spacing);
    double ratio = 0;
    constexpr int kDepths = 24;
    for (int k = 0; k < kDepths; ++k) {
      const TouchForce f = patient.touch({FingerShape::kRoundedTip, radius, 0, 0}, .02, .0010 + 2e-5 * k);
      const double half = (f.contact_width_m + spacing) / 2;
      ratio += -f.force_n[1] / (std::numbers::pi * effective * half * half / (4 * radius) * t.thickness_m) /
               kDepths;
    }
    return ratio;
  };
  EXPECT_NEAR(2 * mean_ratio(.00025) - mean_ratio(.0005), 1, .03);
}

TEST(Touch, ForceConvergesUnderRefinement) {
  const double spacing[3] = {.001, .0005, .00025};
  const Finger tip;
  for (const double x : {.0403, .055, .0907}) {
    double force[3];
    for (int k = 0; k < 3; ++k) force[k] = Patient(small_tissue(), spacing[k]).touch(tip, x, .003).force_n[1];
    EXPECT_LE(std::abs(force[1] / force[2] - 1), .01) << x;
    EXPECT_LE(std::abs(force[0] / force[2] - 1), .03) << x;
  }
}

TEST(Touch, IsContinuousAlongUniformTissue) {
  Tissue t = small_tissue();
  t.inclusions.clear();
  const Patient patient(t);
  double least = 1e9, most = 0;
  for (int k = 0; k < 200; ++k) {
    const double f = -patient.touch({}, .055 + 5e-5 * k, .004).force_n[1];
    least = std::min(least, f), most = std::max(most, f);
  }
  EXPECT_LE(most / least, 1.01);
  EXPECT_GT(least, 0);
}

TEST(Touch, FeelsTheInclusionAndNothingAboveTheSurface) {
  const Patient patient(small_tissue());
  for (const Finger& finger : kFingers) {
    EXPECT_LT(patient.touch(finger, .055, .003).force_n[1],
              1.05 * patient.touch(finger, .025, .003).force_n[1]);
    EXPECT_EQ(patient.touch(finger, .055, 0).force_n[1], 0);
    EXPECT_EQ(patient.touch(finger, .055, -.001).energy_j, 0);
  }
}

TEST(Touch, RefusesWhatItCannotDo) {
  const Patient patient(small_tissue());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(patient.touch({}, -.001, .001), std::invalid_argument);
  EXPECT_THROW(patient.touch({}, .121, .001), std::invalid_argument);
  EXPECT_THROW(patient.touch({}, nan, .001), std::invalid_argument);
  EXPECT_THROW(patient.touch({}, .05, .031), std::invalid_argument);
  EXPECT_THROW(patient.touch({}, .05, nan), std::invalid_argument);
  EXPECT_THROW(patient.touch({FingerShape::kRoundedTip, 0, 0, 0}, .05, .001), std::invalid_argument);
}

TEST(Sensor, NoiseIsAsStatedAndSeeded) {
  const Probe probe;
  double sum = 0, squares = 0;
  constexpr int kReadings = 20000;
  for (int k = 0; k < kReadings; ++k) {
    const double error = sensed_force(probe, .2, static_cast<std::uint64_t>(k)) - .2;
    sum += error, squares += error * error;
  }
  const double stated = std::hypot(.01 * .2, .002);
  EXPECT_NEAR(std::sqrt(squares / kReadings) / stated, 1, .03);
  EXPECT_NEAR(sum / kReadings, 0, 4 * stated / std::sqrt(kReadings));
  EXPECT_EQ(sensed_force(probe, .2, 5), sensed_force(probe, .2, 5));
  EXPECT_NE(sensed_force(probe, .2, 5), sensed_force(probe, .2, 6));
}

}  // namespace
}  // namespace teletact::client
