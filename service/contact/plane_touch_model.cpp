#include "service/contact/plane_touch_model.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/base/choices.h"
#include "service/contact/contact.h"
#include "service/contact/fingertip.h"

namespace teletact::service {
namespace {

// Half of the width that a contact asks for.
double touched_m(const Fingertip& tip, double indentation_m) {
  if (tip.shape == FingertipShape::kNode) return 3 * tip.footprint_m;
  return reach_m(tip, indentation_m, choices::kCandidateMargin * indentation_m);
}

class PlaneLayer final : public TouchedLayer {
 public:
  // `device`: by which the compliance is solved; null: it is condensed.
  PlaneLayer(std::shared_ptr<const TissueModel> tissue, std::shared_ptr<const PlaneBudget> budget,
             std::size_t row, std::shared_ptr<Compliance> compliance, std::shared_ptr<Device> device)
      : TouchedLayer(std::move(device)),
        tissue_(std::move(tissue)),
        budget_(std::move(budget)),
        row_(row),
        compliance_(std::move(compliance)) {}

  ContactAnswer answer(const Fingertip& tip, const TouchPose& pose) override {
    ContactAnswer answer;
    if (wanted(tip, pose, 0)) {
      answer.state = ContactState::kContact;
      answer.solve.converged = false, answer.solve.improving = true;
      answer.solve.reason = "not solved yet";
      answer.solve.relative_error = HUGE_VAL;
      return answer;
    }
    answer = solve_contact(tissue_->problem(), row_, *compliance_, tip, in_plane(pose));
    if (answer.state == ContactState::kContact && tip.shape == FingertipShape::kRoundedTip &&
        tip.friction == Friction::kFrictionless && row_ == 0)
      budget_->add(tip, pose.position_m[0], pose.position_m[1], answer);
    answer.path = device() ? SolvePath::kGradients : SolvePath::kCompliance;
    answer.remark = remark(tip, in_plane(pose));
    return answer;
  }

  // The columns of the contact that are not solved yet.
  std::optional<TouchJob> wanted(const Fingertip& tip, const TouchPose& pose, double around_m) override {
    const PlanePose at = in_plane(pose);
    if (!device() || !(at.indentation_m > 0 || around_m > 0)) return std::nullopt;
    const double reach = std::max(around_m, touched_m(tip, std::max(0.0, at.indentation_m)));
    const std::vector<double>& columns_m = tissue_->problem().grid.x_m;
    std::vector<std::size_t> nodes = touchable_columns(at.x_m, reach);
    std::sort(nodes.begin(), nodes.end(), [&](std::size_t a, std::size_t b) {
      return std::abs(columns_m[a] - at.x_m) < std::abs(columns_m[b] - at.x_m);
    });
    const bool stuck = tip.friction == Friction::kStuck;
    if (compliance_->prepare(nodes, stuck, {})) return std::nullopt;
    return TouchJob{HUGE_VAL, JobWait::kFirst,
                    [this, stuck, nodes = std::move(nodes)](Clock::time_point until) {
                      return compliance_->prepare(nodes, stuck, until);
                    }};
  }

  std::optional<DeformedLayer> deformed(const Fingertip& tip, const TouchPose& pose, double around_m,
                                        std::size_t max_nodes) const override {
    const std::vector<double>& columns_m = tissue_->problem().grid.x_m;
    const ContactAnswer answer = solve_contact(tissue_->problem(), row_, *compliance_, tip, in_plane(pose));
    std::vector<std::size_t> loaded;
    Eigen::Matrix2Xd force_n_m(2, answer.pressure.size());
    for (const NodalPressure& node : answer.pressure) {
      const auto b = static_cast<Eigen::Index>(loaded.size());
      force_n_m.col(b) = node.width_m[0] * Eigen::Vector2d(node.traction_pa[0], node.pressure_pa);
      const auto at = std::ranges::lower_bound(columns_m, node.position_m[0]);
      loaded.push_back(static_cast<std::size_t>(at - columns_m.begin()));
    }
    const std::vector<std::size_t> shown = every(touchable_columns(pose.position_m[0], around_m), max_nodes);
    DeformedLayer out{{}, {pose.position_m[2]}, {}};
    for (const std::size_t i : shown) out.x_m.push_back(columns_m[i]);
    const Eigen::VectorXd moved = compliance_->axial_under(shown, loaded, force_n_m);
    out.displacement_m.assign(moved.begin(), moved.end());
    return out;
  }

  std::array<double, 2> spacing_m(double x_m) const override {
    const std::vector<double>& columns_m = tissue_->problem().grid.x_m;
    const auto right = std::upper_bound(columns_m.begin() + 1, columns_m.end() - 1, x_m);
    return {*right - *(right - 1), 0};
  }

 private:
  std::string remark(const Fingertip& tip, const PlanePose& at) const {
    if (tip.shape == FingertipShape::kNode) return "";
    const std::vector<double>& columns_m = tissue_->problem().grid.x_m;
    const double reach = reach_m(tip, std::max(at.indentation_m, choices::kLightTouch), 0);
    double widest_m = 0;
    for (std::size_t i = 0; i + 1 < columns_m.size(); ++i)
      if (columns_m[i + 1] > at.x_m - reach && columns_m[i] < at.x_m + reach)
        widest_m = std::max(widest_m, columns_m[i + 1] - columns_m[i]);
    return coarse_mesh(tip, at.indentation_m, widest_m);
  }

  std::vector<std::size_t> touchable_columns(double x_m, double reach_m) const {
    const TissueProblem& tissue = tissue_->problem();
    std::vector<std::size_t> columns;
    for (std::size_t i = tissue.touchable.first; i <= tissue.touchable.last; ++i)
      if (std::abs(tissue.grid.x_m[i] - x_m) <= reach_m) columns.push_back(i);
    return columns;
  }
  static PlanePose in_plane(const TouchPose& pose) { return {pose.position_m[0], pose.position_m[1]}; }

  const std::shared_ptr<const TissueModel> tissue_;
  const std::shared_ptr<const PlaneBudget> budget_;
  const std::size_t row_;
  const std::shared_ptr<Compliance> compliance_;
};

}  // namespace

// The compliances of one model that touches ask for. Making one ready takes from milliseconds to seconds, so
// it is done elsewhere: a touch gets one where it is there, and nothing while it is being made. Thread-safe.
class PlaneTouchModel::PreparedCompliances : public std::enable_shared_from_this<PreparedCompliances> {
 public:
  explicit PreparedCompliances(std::shared_ptr<const TissueModel> model) : model_(std::move(model)) {}

  // As TissueModel::compliance(). Null while it is being made, which this asks `work` for, in the client's
  // turn. Throws what making it throws, here or elsewhere.
  std::shared_ptr<Compliance> get(std::size_t row, const std::shared_ptr<Device>& device,
                                  const TouchWork& work, const std::string& client) {
    if (auto ready = model_->ready(row, device)) return ready;
    if (!work) return model_->compliance(row, device);
    const Key key{row, device};
    {
      const std::lock_guard lock(mutex_);
      Entry& entry = entries_[key];
      if (entry.asked.contains(client)) return nullptr;
      if (entry.asked.empty() && entry.error && Clock::now() < entry.retry)
        std::rethrow_exception(entry.error);
      entry.asked.insert(client);
    }
    work(client, [self = shared_from_this(), key] { self->make_for_others(key); });
    return nullptr;
  }

 private:
  using Clock = std::chrono::steady_clock;
  using Key = std::pair<std::size_t, std::shared_ptr<Device>>;
  // One that could not be made is tried again after this long; until then asking for it says why.
  static constexpr std::chrono::seconds kRetry{1};
  struct Entry {
    std::set<std::string> asked;  // clients in whose turns it is to be made; none: it is not
    std::exception_ptr error;     // why it could not be made, the last time
    Clock::time_point retry{};
  };

  void make_for_others(const Key& key) {
    {
      const std::lock_guard lock(mutex_);
      if (entries_[key].asked.empty()) return;  // made in another's turn
    }
    std::exception_ptr error;
    try {
      model_->compliance(key.first, key.second);  // which keeps it
    } catch (const std::exception& e) {
      error = std::current_exception();
      spdlog::warn("event=layer_not_prepared row={} error=\"{}\"", key.first, e.what());
    }
    const std::lock_guard lock(mutex_);
    Entry& entry = entries_[key];
    entry.asked.clear();
    entry.error = std::move(error);
    entry.retry = Clock::now() + kRetry;
  }

  const std::shared_ptr<const TissueModel> model_;
  std::mutex mutex_;  // held for looking things up only
  std::map<Key, Entry> entries_;
};

PlaneTouchModel::PlaneTouchModel(std::shared_ptr<const TissueModel> tissue, MemoryAccount account)
    : TouchModel(std::move(account), {.plane = tissue}),
      tissue_(std::move(tissue)),
      budget_(std::make_shared<PlaneBudget>(tissue_->problem())),
      compliances_(std::make_shared<PreparedCompliances>(tissue_)) {}

Region PlaneTouchModel::region() const {
  const TissueProblem& tissue = tissue_->problem();
  return {tissue.touch_begin_m,
          std::nextafter(tissue.touch_end_m, HUGE_VAL)};  // the last column belongs to it
}

std::vector<Layer> PlaneTouchModel::layers() const {
  return free_layers(tissue_->problem().grid.y_m, tissue_->problem().supports);
}

std::string PlaneTouchModel::plan() const {
  return budget_->words();
}

std::shared_ptr<TouchedLayer> PlaneTouchModel::layer(const Layer& layer, const TouchWay& way,
                                                     const TouchWork& work) const {
  const std::vector<double>& y_m = tissue_->problem().grid.y_m;
  const auto at = std::find(y_m.begin(), y_m.end(), layer.depth_m);
  if (at == y_m.end() || layer.normal != Layer{}.normal)
    throw std::out_of_range(fmt::format("layer {} m deep: no row of nodes", layer.depth_m));
  const auto row = static_cast<std::size_t>(at - y_m.begin());
  const auto device = way.path == SolvePath::kGradients ? way.device : nullptr;
  auto compliance = compliances_->get(row, device, work, way.client);
  if (!compliance) return nullptr;
  return std::make_shared<PlaneLayer>(tissue_, budget_, row, std::move(compliance), device);
}

std::vector<Layer> free_layers(const std::vector<double>& y_m, const Supports& supports) {
  std::vector<Layer> layers;
  for (std::size_t j = 0; j < y_m.size(); ++j) {
    const bool held = (j == 0 && supports.top == EdgeSupport::kFixed) ||
                      (j + 1 == y_m.size() && supports.bottom == EdgeSupport::kFixed);
    if (!held) layers.push_back({y_m[j]});
  }
  return layers;
}

}  // namespace teletact::service
