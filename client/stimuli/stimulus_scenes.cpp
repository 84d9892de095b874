#include "client/stimuli/stimulus_scenes.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <optional>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>

#include "client/clock/clock.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "client/link/touch_link.h"

namespace teletact::client {
namespace {

constexpr double kWidthM = 0.12, kTissueDepthM = 0.03, kBreadthM = 0.06;
constexpr double kPlaneElementM = 0.001, kSolidElementM = 0.002;
constexpr double kToleratedShare = 0.02, kToleratedN = 0.0005;  // what a model may put a force off by
constexpr double kFirstGuessPa = 2000;
constexpr double kMaxContrast = 20;
constexpr unsigned kMaxTouches = 12;
constexpr int kCreateS = 60, kLookS = 5, kRemoveS = 3;

std::string random_name() {
  std::random_device random;
  return fmt::format("experiment-{:08x}", random());
}

void add_nodes(google::protobuf::RepeatedField<double>& nodes, double begin_m, double end_m,
               double element_m) {
  const int parts = static_cast<int>(std::lround((end_m - begin_m) / element_m));
  for (int n = 0; n <= parts; ++n) nodes.Add(begin_m + (end_m - begin_m) * n / parts);
}

std::chrono::system_clock::time_point within(int seconds) {
  return std::chrono::system_clock::now() + std::chrono::seconds(seconds);
}

// It may pass: nobody is there, or not ready yet.
bool may_come_back(const grpc::Status& status) {
  return status.error_code() == grpc::StatusCode::UNAVAILABLE ||
         status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
}

}  // namespace

void validate(const TissueOptions& options) {
  validate(options.place);
  if (!(options.depth_m >= 0.001 && options.depth_m <= 0.008))
    throw std::invalid_argument("depth_m: give 0.001 to 0.008 m; tissue is not linear deeper");
}

std::string condition_of(const std::string& renderer, const TissueOptions& options) {
  std::string text = fmt::format("{} through a service on a {} {:g} mm deep", renderer,
                                 options.solid ? "solid" : "line", 1e3 * options.depth_m);
  const std::string perfect = condition_of(std::nullopt, options.place);
  return text + perfect.substr(std::string(kPerfectStiffness).size());
}

StimulusScenes::StimulusScenes(const TissueOptions& options, const std::atomic<bool>& stop,
                               std::function<void(const std::string&)> say)
    : options_(options), stop_(stop), say_(std::move(say)), name_(random_name()) {
  validate(options_);
  stub_ = v1::Palpation::NewStub(reach_service(options_.address, options_.credentials, say_));
}

StimulusScenes::~StimulusScenes() {
  while (!there_.empty() && remove(there_.back())) continue;
  if (there_.empty()) return;
  std::string names;
  for (const std::string& name : there_) names += " " + name;
  say_("these scenes may still be on the service; take each away with 'teletact-client scenes --service " +
       options_.address + " --delete NAME':" + names);
}

// Tried again while nobody answers, up to kLostS. With `stop` it is CANCELLED at once.
grpc::Status StimulusScenes::retried(const std::string& scene_id, int seconds, const Call& call) {
  constexpr auto kLook = std::chrono::milliseconds(20);
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kLostS);
  for (bool said = false;;) {
    grpc::ClientContext context;
    context.set_deadline(within(seconds));
    name_scene(context, scene_id);
    std::promise<grpc::Status> ended;
    std::future<grpc::Status> status_then = ended.get_future();
    call(context, [&ended](grpc::Status status) { ended.set_value(std::move(status)); });
    while (status_then.wait_for(kLook) != std::future_status::ready)
      if (stop_) context.TryCancel();
    const grpc::Status status = status_then.get();
    if (stop_) return grpc::Status::CANCELLED;
    if (!may_come_back(status)) return status;
    const std::string why = "the service at " + options_.address + " is lost (" + describe(status) + ")";
    if (std::chrono::steady_clock::now() > end) throw DisplayLost(fmt::format("{} for {:g} s", why, kLostS));
    if (!std::exchange(said, true)) say_(why + "; waiting for it");
    std::this_thread::sleep_for(5 * kLook);
  }
}

Vector3 StimulusScenes::middle_m() const {
  return {kWidthM / 2 + (options_.place.width_m > 0 ? kInclusionCentreM / 2 : 0), 0, 0};
}

Vector3 StimulusScenes::start_m() const {
  return {middle_m().x() - (options_.place.width_m > 0 ? kInclusionCentreM : 0), 0, 0};
}

v1::TouchOpen StimulusScenes::open(const std::string& scene_id) const {
  v1::TouchOpen open;
  open.set_scene_id(scene_id);
  open.mutable_fingertip()->set_shape(v1::FINGERTIP_SHAPE_ROUNDED_TIP);
  open.mutable_tolerance()->set_relative(kToleratedShare);
  open.mutable_tolerance()->set_force_n(kToleratedN);
  open.set_credit(Pacing::kMax);
  open.set_period_s(0.002);
  return open;
}

v1::CreateSceneRequest StimulusScenes::request_of(const Made& made) const {
  v1::CreateSceneRequest request;
  request.set_scene_id(made.scene_id);
  request.mutable_geometry()->add_size_m(kWidthM);
  request.mutable_geometry()->add_size_m(kTissueDepthM);
  request.mutable_geometry()->set_linear(true);
  v1::ModulusMap& map = *request.mutable_modulus();
  const double element_m = options_.solid ? kSolidElementM : kPlaneElementM;
  add_nodes(*map.mutable_x_m(), 0, kWidthM, element_m);
  add_nodes(*map.mutable_y_m(), 0, kTissueDepthM, element_m);
  if (options_.solid) add_nodes(*map.mutable_z_m(), -kBreadthM / 2, kBreadthM / 2, element_m);
  const int columns = map.x_m_size() - 1, rows = map.y_m_size() - 1, slices = std::max(map.z_m_size() - 1, 1);
  const auto modulus_pa = [&](int i, int k) {
    if (options_.place.width_m <= 0) return made.modulus_pa;
    const double x_m = (map.x_m(i) + map.x_m(i + 1)) / 2 - middle_m().x();
    const double z_m = options_.solid ? (map.z_m(k) + map.z_m(k + 1)) / 2 : 0;
    const double beyond_m = std::hypot(x_m, z_m) - options_.place.width_m / 2;
    const double inside = 1 / (1 + std::exp(beyond_m / options_.place.edge_m));
    return made.background_pa * std::pow(made.modulus_pa / made.background_pa, inside);
  };
  std::vector<float> values;
  for (int k = 0; k < slices; ++k)
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns; ++i) values.push_back(static_cast<float>(modulus_pa(i, k)));
  v1::Array& array = *map.mutable_youngs_modulus_pa();
  array.set_dtype(v1::DATA_TYPE_FLOAT32);
  if (options_.solid) array.add_shape(static_cast<std::uint32_t>(slices));
  array.add_shape(static_cast<std::uint32_t>(rows));
  array.add_shape(static_cast<std::uint32_t>(columns));
  array.set_data(values.data(), values.size() * sizeof(float));
  return request;
}

void StimulusScenes::create(const Made& made) {
  const v1::CreateSceneRequest request = request_of(made);
  if (std::ranges::find(there_, made.scene_id) == there_.end()) there_.push_back(made.scene_id);
  v1::Scene scene;
  unsigned tries = 0;
  const grpc::Status status =
      retried(made.scene_id, kCreateS, [&](grpc::ClientContext& context, const Done& done) {
        ++tries;
        stub_->async()->CreateScene(&context, &request, &scene, done);
      });
  // Of an attempt whose answer was lost.
  const bool made_before = tries > 1 && status.error_code() == grpc::StatusCode::ALREADY_EXISTS;
  if (status.ok() || stop_ || made_before) return;
  std::string remedy;
  if (status.error_code() == grpc::StatusCode::PERMISSION_DENIED)
    remedy = "; give the --token-file of an administrator of all scenes";
  if (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED)
    remedy = "; give fewer --stimuli, or take old scenes away (teletact-client scenes --delete)";
  throw std::runtime_error("the service at " + options_.address + " does not take a tissue (" +
                           describe(status) + ")" + remedy);
}

bool StimulusScenes::exists(const std::string& scene_id) {
  v1::GetSceneRequest request;
  request.set_scene_id(scene_id);
  v1::Scene scene;
  const grpc::Status status = retried(scene_id, kLookS, [&](grpc::ClientContext& context, const Done& done) {
    stub_->async()->GetScene(&context, &request, &scene, done);
  });
  if (!status.ok() && !stop_ && status.error_code() != grpc::StatusCode::NOT_FOUND)
    throw std::runtime_error("the service at " + options_.address + " does not show scene '" + scene_id +
                             "' (" + describe(status) + ")");
  return status.ok() || stop_;
}

// False where that is not known to have gone well.
bool StimulusScenes::remove(const std::string& scene_id) {
  grpc::ClientContext context;
  context.set_deadline(within(kRemoveS));
  name_scene(context, scene_id);
  v1::DeleteSceneRequest request;
  request.set_scene_id(scene_id);
  v1::DeleteSceneResponse response;
  const grpc::Status status = stub_->DeleteScene(&context, request, &response);
  if (!status.ok() && status.error_code() != grpc::StatusCode::NOT_FOUND) return false;
  std::erase(there_, std::string(scene_id));
  return true;
}

// Its stiffness, in N/m: of the first answer after which others say the same; 0 with `stop`, and where the
// service answers and gives no force.
double StimulusScenes::touch(const std::string& scene_id) {
  constexpr double kSameS = 0.15, kSame = 1e-3;
  LatestSlot<ServoPose> poses;
  LatestSlot<ServoAnswer> answers;
  MonotonicClock clock;
  TouchLink link({options_.address, options_.credentials, open(scene_id)}, poses, answers, clock);
  ServoPose pose;
  pose.pose.position_m = middle_m() + Vector3(0, options_.depth_m, 0);
  const std::int64_t begin_ns = clock.now_ns();
  double stiffness_n_m = 0, since_s = 0;
  bool answered = false;
  std::string why = "it does not answer";
  pose.time_ns = begin_ns;
  poses.put(pose);
  link.start();
  for (ServoAnswer answer; !stop_;) {
    const double now_s = seconds(clock.now_ns() - begin_ns);
    const bool fresh = answers.take(answer);
    answered = answered || fresh;
    if (fresh && answer.has_force && answer.sample.contact) {
      const double newest_n_m = -answer.sample.force_n.y() / options_.depth_m;
      if (!(std::abs(newest_n_m - stiffness_n_m) <= kSame * stiffness_n_m))
        stiffness_n_m = newest_n_m, since_s = now_s;
      if (now_s - since_s >= kSameS && stiffness_n_m > 0) return stiffness_n_m;
    }
    if (const std::string failure = link.failure(); !failure.empty())
      throw std::runtime_error("the service at " + options_.address + " refused the touch: " + failure);
    if (const std::string trouble = link.trouble(); !trouble.empty()) why = trouble;
    if (now_s > kLostS && answered && link.trouble().empty()) return 0;
    if (now_s > kLostS)
      throw DisplayLost(fmt::format("the service at {} was touched for {:g} s in vain ({})", options_.address,
                                    kLostS, why));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    pose.time_ns = clock.now_ns();
    poses.put(pose);
  }
  return 0;
}

StimulusScenes::Made StimulusScenes::make_one(double stiffness_n_m, double guess_pa) {
  struct Touched {
    double log_pa, log_n_m;
  };
  std::optional<Touched> before;
  Made made{stiffness_n_m, guess_pa, background_pa_ > 0 ? background_pa_ : guess_pa, ""};
  const bool lump = options_.place.width_m > 0 && background_pa_ > 0;
  for (unsigned k = 0; k < kMaxTouches; ++k) {
    made.scene_id = fmt::format("{}-{}", name_, ++created_);
    if (background_pa_ <= 0) made.background_pa = made.modulus_pa;
    create(made);
    const double felt_n_m = touch(made.scene_id);
    if (stop_ || std::abs(felt_n_m / stiffness_n_m - 1) <= kOffMax) return made;
    remove(made.scene_id);
    if (!(felt_n_m > 0)) break;
    const Touched now{std::log(made.modulus_pa), std::log(felt_n_m)};
    const bool tells = before && std::abs(now.log_pa - before->log_pa) > 1e-9;
    const double slope =
        tells ? std::clamp((now.log_n_m - before->log_n_m) / (now.log_pa - before->log_pa), 0.05, 1.0) : 1.0;
    before = now;
    made.modulus_pa *= std::exp((std::log(stiffness_n_m) - now.log_n_m) / slope);
    if (lump &&
        !(made.modulus_pa < kMaxContrast * background_pa_ && made.modulus_pa > background_pa_ / kMaxContrast))
      break;
  }
  if (lump)
    throw std::invalid_argument(
        fmt::format("stimuli_n_m: a lump {:g} mm wide is not felt as {:g} N/m in this background, however "
                    "hard or soft it is; give a wider --inclusion-m, or stimuli nearer to the background",
                    1e3 * options_.place.width_m, stiffness_n_m));
  throw std::runtime_error("the service at " + options_.address +
                           " gives such a tissue no force that is proportional to its modulus; see its log");
}

void StimulusScenes::make(const std::vector<double>& stimuli_n_m, double background_n_m) {
  double known_pa = kFirstGuessPa, known_n_m = 0;
  const auto one = [&](double stiffness_n_m) {
    if (stop_) return;
    const double guess_pa = known_n_m > 0 ? known_pa * stiffness_n_m / known_n_m : known_pa;
    made_.push_back(make_one(stiffness_n_m, guess_pa));
    if (known_n_m == 0) known_pa = background_pa_ = made_.back().modulus_pa, known_n_m = stiffness_n_m;
  };
  one(background_n_m);
  for (const double stimulus_n_m : stimuli_n_m)
    if (stimulus_n_m != background_n_m) one(stimulus_n_m);
}

void StimulusScenes::make_sure() {
  for (const Made& made : made_)
    if (!stop_ && !exists(made.scene_id)) create(made);
}

const std::string& StimulusScenes::scene_of(double stiffness_n_m) const {
  for (const Made& made : made_)
    if (made.stiffness_n_m == stiffness_n_m) return made.scene_id;
  throw std::invalid_argument("stimuli_n_m: no tissue was made of that stiffness");
}

}  // namespace teletact::client
