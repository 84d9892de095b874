#include "tests/vectors/recorder/product.h"

#include <cmath>
#include <limits>

#include "client/patient/rf.h"
#include "client/render/renderers.h"
#include "client/servo/servo_loop.h"
#include "service/contact/contact.h"
#include "service/imaging/estimate.h"
#include "service/tissue/tissue_model.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/windows.h"

namespace teletact::vectors {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

const std::shared_ptr<service::Device>& device() {
  static const std::shared_ptr<service::Device> opened = service::Device::open();
  return opened;
}

template <class Values>
std::vector<double> numbers(const Values& values) {
  return {values.begin(), values.end()};
}

// ---- imaging

Answer tracking_of(const service::Estimate& e) {
  return {{"axial_displacement", numbers(e.axial_displacement)},
          {"lateral_displacement", numbers(e.lateral_displacement)},
          {"axial_displacement_std", numbers(e.axial_displacement_std)},
          {"lateral_displacement_std", numbers(e.lateral_displacement_std)},
          {"axial_strain", numbers(e.axial_strain)},
          {"lateral_strain", numbers(e.lateral_strain)},
          {"shear_strain", numbers(e.shear_strain)},
          {"axial_strain_std", numbers(e.axial_strain_std)},
          {"lateral_strain_std", numbers(e.lateral_strain_std)},
          {"shear_strain_std", numbers(e.shear_strain_std)},
          {"correlation", numbers(e.correlation)},
          {"displacement_valid", numbers(e.displacement_valid)},
          {"strain_valid", numbers(e.strain_valid)},
          {"median_correlation", {e.median_correlation}},
          {"quality", {e.quality}}};
}

Answer modulus_of(const service::Estimate& e) {
  std::vector<double> flags;
  for (const service::Warning& warning : e.modulus.warnings)
    flags.push_back(static_cast<double>(warning.flag));
  return {{"youngs_modulus", numbers(e.modulus.youngs_modulus)},
          {"youngs_modulus_log_std", numbers(e.modulus.log_deviation)},
          {"valid", numbers(e.valid)},
          {"background", {e.modulus.background}},
          {"mean_axial_strain", {e.modulus.mean_axial_strain}},
          {"converged", {e.modulus.converged ? 1.0 : 0.0, e.modulus.absolute ? 1.0 : 0.0}, true},
          {"flags", flags, true}};
}

service::RfFrame frame_of(const client::RfGeometry& geometry, const std::vector<std::int16_t>& samples) {
  return {geometry.sample_count, geometry.line_count, {samples.begin(), samples.end()}};
}

}  // namespace

std::vector<Estimated> estimate(const PatientCase& c) {
  constexpr double kNoLimitS = 1e6;
  const client::Tissue t = client::parse_tissue(c.tissue);
  const client::Patient patient(t);
  const client::ProbeState probe = patient.press(c.window_m, t.probe.compression_m);
  const client::RfPair rf = client::with_noise(
      client::simulate_rf(t, probe, c.lab_frame ? client::RfFrame::kLab : client::RfFrame::kProbe, t.seed),
      t.seed + 1);
  service::AcquisitionGeometry g;
  g.center_frequency_hz = t.ultrasound.center_frequency_hz;
  g.sampling_frequency_hz = t.ultrasound.sampling_frequency_hz;
  g.sound_speed_m_s = t.ultrasound.sound_speed_m_s;
  g.line_pitch_m = rf.geometry.line_pitch_m;
  g.frame = c.lab_frame ? service::DisplacementFrame::kLab : service::DisplacementFrame::kProbe;
  std::optional<service::ProbeForce> force;
  if (c.sensed) force = {client::sensed_force(t.probe, probe.force_n, t.seed + 2), probe.contact_area_m2};
  service::KnownModulus known;
  if (c.neighbours) {
    known.modulus_pa = [&](double x_m, double y_m) {
      const bool inside = x_m >= c.window_m && x_m < c.window_m + t.probe.width_m;
      return inside ? kNone : t.true_modulus(x_m, y_m);
    };
    known.log_deviation = [](double, double) { return 0.1; };
  }
  service::Elastography elastography(device());
  const auto by = [&](service::ModulusKind kind) {
    return elastography.estimate(
        frame_of(rf.geometry, rf.pre), frame_of(rf.geometry, rf.post),
        {g, force, {t.width_m, t.depth_m, c.window_m, t.poisson_ratio}, known, {kind, kNoLimitS}});
  };
  const service::Estimate iterative = by(service::ModulusKind::kIterative);
  return {{"tracking", tracking_of(iterative)},
          {"iterative", modulus_of(iterative)},
          {"direct", modulus_of(by(service::ModulusKind::kDirect))},
          {"reference-stress", modulus_of(by(service::ModulusKind::kReferenceStress))}};
}

// ---- touch

namespace {

service::Fingertip fingertip_of(const Finger& f) {
  service::Fingertip tip;
  tip.friction = f.stuck ? service::Friction::kStuck : service::Friction::kFrictionless;
  switch (f.tip) {
    case Tip::kRounded:
      tip.shape = service::FingertipShape::kRoundedTip;
      tip.radius_m = f.size_m;
      break;
    case Tip::kPunch:
      tip.shape = service::FingertipShape::kFlatPunch;
      tip.half_width_m = f.size_m;
      break;
    case Tip::kNode:
      tip.shape = service::FingertipShape::kNode;
      tip.footprint_m = f.size_m;
      break;
  }
  return tip;
}

service::SceneGeometry geometry_of(const TissueCase& c) {
  const auto support = [](bool held) {
    return held ? service::EdgeSupport::kFixed : service::EdgeSupport::kFree;
  };
  service::SceneGeometry g;
  g.width_m = c.width_m;
  g.depth_m = c.depth_m;
  g.poisson_ratio = c.poisson_ratio;
  g.supports = {support(c.top), support(c.bottom), support(c.left), support(c.right)};
  return g;
}

service::ExplicitModulus explicit_of(const TissueCase& c) {
  constexpr double kSquareM = 0.001;
  const auto count = [](double length_m) {
    return static_cast<std::size_t>(std::lround(length_m / kSquareM));
  };
  service::ExplicitModulus e;
  e.x_m = service::uniform_coordinates(0, c.width_m, count(c.width_m));
  e.y_m = service::uniform_coordinates(0, c.depth_m, count(c.depth_m));
  for (std::size_t j = 0; j + 1 < e.y_m.size(); ++j)
    for (std::size_t i = 0; i + 1 < e.x_m.size(); ++i)
      e.youngs_modulus_pa.push_back(
          c.modulus_pa((e.x_m[i] + e.x_m[i + 1]) / 2, (e.y_m[j] + e.y_m[j + 1]) / 2));
  return e;
}

// What is recorded of a plane scene.
std::vector<double> plane_force(const service::ContactAnswer& c) {
  return {c.force_n[0], c.force_n[1]};
}
std::vector<double> plane_tangent(const service::ContactAnswer& c) {
  return {c.tangent_n_m[0], c.tangent_n_m[1], c.tangent_n_m[3], c.tangent_n_m[4]};
}

Answer contact_of(const service::ContactAnswer& c) {
  double pressure = 0, moment = 0, traction = 0;
  for (const service::NodalPressure& p : c.pressure)
    pressure += p.pressure_pa, moment += p.pressure_pa * p.position_m[0], traction += p.traction_pa[0];
  return {{"contact", {static_cast<double>(c.state), static_cast<double>(c.pressure.size())}, true},
          {"force", plane_force(c)},
          {"tangent", plane_tangent(c)},
          {"energy", {c.energy_j}},
          {"strain", {c.largest_strain}},
          {"pressure", {pressure}},
          {"moment", {moment}},
          {"traction", {traction}}};
}

}  // namespace

struct Touching::Product {
  TissueCase tissue;
  service::Fingertip tip;
  std::shared_ptr<service::Scene> scene;
  std::unique_ptr<service::TouchSession> session;
};

Touching::Touching(const TissueCase& c, const Finger& f)
    : product_(std::make_unique<Product>(Product{c, fingertip_of(f), nullptr, nullptr})) {
  auto& scene = product_->scene;
  if (c.window_width_m > 0)
    scene = std::make_shared<service::Scene>("windows", geometry_of(c), service::versions());
  else
    scene = std::make_shared<service::Scene>("explicit", geometry_of(c), explicit_of(c), service::versions());
  for (const double window_m : c.windows) publish(window_m, c.modulus_pa);
  product_->session = std::make_unique<service::TouchSession>(
      scene, service::TouchOptions{product_->tip, f.layer_m, service::SolvePath::kCompliance}, nullptr);
}

Touching::~Touching() = default;

double Touching::layer_m() const {
  return product_->session->layer().depth_m;
}

void Touching::publish(double window_m, const Modulus& modulus_pa) {
  const TissueCase& c = product_->tissue;
  product_->scene->publish(service::window_of(modulus_pa, window_m, c.window_width_m, c.depth_m));
  while (product_->scene->refresh_stale_window()) {
  }
}

Answer Touching::touch(double x_m, double y_m) {
  const service::TouchAnswer a = product_->session->solve({x_m, y_m});
  Answer answer = contact_of(a.contact);
  answer.push_back({"status",
                    {static_cast<double>(a.status), static_cast<double>(a.path),
                     static_cast<double>(a.window_id), static_cast<double>(a.model_version)},
                    true});
  answer.push_back({"covered", {a.covered.begin_x_m, a.covered.end_x_m}});
  const service::ForeseenTouch foreseen = a.foreseen.value_or(service::ForeseenTouch{{kNone, kNone, 0}, {}});
  answer.push_back({"foreseen_at", {foreseen.position_m[0], foreseen.position_m[1]}});
  answer.push_back({"foreseen_force", plane_force(foreseen.contact)});
  answer.push_back({"foreseen_tangent", plane_tangent(foreseen.contact)});
  return answer;
}

Answer Touching::touch_iteratively(double x_m, double indentation_m) {
  const service::TissueModel& model = service::tissue_of(*product_->scene->snapshot()->windows.front());
  constexpr std::size_t kSurface = 0;
  return contact_of(service::solve_contact(model.problem(), kSurface, *model.compliance(kSurface, device()),
                                           product_->tip, {x_m, indentation_m}));
}

// ---- servo

namespace {

// Stands where the case puts it.
class PathDevice final : public client::HapticDevice {
 public:
  const client::DeviceProfile& profile() const noexcept override { return profile_; }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t, client::DeviceReading& out) noexcept override {
    out = reading;
    return answers;
  }
  bool write(const client::Vector3& force_n) noexcept override {
    written_n = force_n;
    return answers;
  }
  client::DeviceReading reading;
  client::Vector3 written_n = client::Vector3::Zero();
  bool answers = true;

 private:
  const client::DeviceProfile& profile_ = client::device_profile("premium-1.5");
};

client::ServoAnswer servo_answer(const ForceAnswer& a, std::int64_t received_ns) {
  client::ServoAnswer out;
  out.sample.sequence = a.sequence;
  out.sample.pose_time_s = a.pose_time_s;
  out.sample.position_m = {a.x_m, a.y_m, 0};
  out.sample.force_n = {a.force_n[0], a.force_n[1], 0};
  out.sample.tangent_n_m.topLeftCorner<2, 2>() << a.tangent_n_m[0], a.tangent_n_m[1], a.tangent_n_m[2],
      a.tangent_n_m[3];
  out.sample.contact = a.contact;
  out.sample.foreseen = a.foreseen;
  out.has_force = a.has_force;
  out.degraded = a.degraded;
  out.covered = true;
  out.region.end_x_m = 0.12;
  out.received_ns = received_ns;
  out.period_s = 0.004;
  return out;
}

client::ServoOptions options_of(const PathDevice& device) {
  client::ServoOptions options;
  options.chain.limits = device.profile().limits();
  return options;
}

double flag(bool value) {
  return value ? 1 : 0;
}

}  // namespace

struct Servo::Product {
  Product()
      : renderer(client::make_renderer("kalman", client::ServoOptions{}.period_s)),
        loop(device, *renderer, clock, options_of(device)) {}
  PathDevice device;
  client::ManualClock clock;
  std::unique_ptr<client::Renderer> renderer;
  client::ServoLoop loop;
};

Servo::Servo() : product_(std::make_unique<Product>()) {}
Servo::~Servo() = default;

Answer Servo::tick(const TickCase& c) {
  Product& p = *product_;
  p.clock.time_ns = c.time_ns;
  p.device.reading.pose = {{c.x_m, c.y_m, 0}, {c.velocity_x_m_s, c.velocity_y_m_s, 0}};
  p.device.reading.resume_pressed = c.resume;
  p.device.answers = c.device_answers;
  if (c.answer) p.loop.answers().put(servo_answer(*c.answer, c.time_ns));
  if (c.pause) p.loop.request_pause();
  p.loop.tick(c.time_ns);
  client::ServoTick t;
  p.loop.telemetry().pop(t);
  return {{"state",
           {static_cast<double>(t.state), static_cast<double>(t.reason), static_cast<double>(t.sequence)},
           true},
          {"force", {p.device.written_n.x(), p.device.written_n.y()}},
          {"stiffness", {t.stiffness_n_m, t.lateral_stiffness_n_m.x()}},
          {"variance", {t.stiffness_variance, t.lateral_stiffness_variance.x()}},
          {"gain", {t.gain}},
          {"energy", {t.energy_j, t.stored_j}},
          {"damping", {t.damping_n_s_m}},
          {"withheld", {t.withheld}},
          {"age", {t.silence_s, t.model_age_s}},
          {"flags",
           {flag(t.withholds), flag(t.degraded), flag(t.energy_generated), flag(t.service_degraded),
            flag(t.faded)},
           true}};
}

}  // namespace teletact::vectors
