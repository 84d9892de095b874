#include "service/imaging_plane/imaging_lane.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "service/base/seconds.h"
#include "service/device/cancellation.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

using Seconds = std::chrono::duration<double>;

// The rest is for its way here.
constexpr double kOfCrossing = 0.85;

}  // namespace

ImagingLane::ImagingLane(std::size_t number, CurrentDevice& device, Workers& workers, Publisher& publisher,
                         std::shared_ptr<MemoryBudget> memory, Options options)
    : device_(device),
      workers_(workers),
      publisher_(publisher),
      memory_(std::move(memory)),
      options_(std::move(options)),
      engines_(device, options_.turns.size() + 1),
      recovery_(
          number, [this] { open_again(); }, options_.tell) {
  device_.on_failure([this](const std::string& why) { recovery_.failed(why); });
}

Workers::Running<void> ImagingLane::warm() {
  return workers_.run(any(), [this] {
    const std::shared_ptr<Device> device = device_;
    if (device->was_tried()) return;  // by another service of this process
    engines_.borrow("")->warm();
    options_.warm(device);
    device->tried();
  });
}

bool ImagingLane::works() const {
  return recovery_.works() && std::ranges::all_of(options_.turns, [this](std::size_t turns) {
           return workers_.silent_s(turns) < stalled_s_;
         });
}

double ImagingLane::busy_s() const {
  double s = 0;
  for (const std::size_t turns : options_.turns) s += workers_.worked_s(turns);
  return s / static_cast<double>(options_.turns.size());
}

// A new device, tried by an estimate and by touch's kernels; then it is everybody's.
void ImagingLane::open_again() {
  const std::shared_ptr<Device> device = options_.reopen();
  workers_
      .run(any(),
           [this, device] {
             engines_.use(device);
             engines_.borrow("")->warm();
             options_.warm(device);
           })
      .future.get();
  device_.replace(device);
}

JobTerms ImagingLane::terms(const EstimateRequest& request, const JobTerms& asked) const {
  JobTerms terms = asked;
  terms.cost_s = cost_.expected_s(request.size());
  if (request.finish_within_s > 0)
    terms.deadline = std::min(terms.deadline, Clock::now() + seconds(request.finish_within_s));
  return terms;
}

void ImagingLane::require_in_time(const EstimateRequest& request, const JobTerms& terms, double done_in_s,
                                  const char* words) {
  const double left_s = Seconds(terms.deadline - Clock::now()).count();
  if (done_in_s <= left_s) return;
  cost_.refused(request.size(), left_s);
  throw Error(ErrorKind::kDeadline, fmt::format(fmt::runtime(words), done_in_s));
}

double ImagingLane::done_in_s(const EstimateRequest& request, const JobTerms& asked) const {
  JobTerms terms = this->terms(request, asked);
  terms.cost_s = Schedule::kSliceS;  // of devices alike, the one that was measured may look the quicker one
  return workers_.done_in_s(terms);
}

double ImagingLane::min_s(const EstimateRequest& request) const {
  return cost_.min_s(request.size(), request.planned());
}

// What a limit leaves is counted, and the same on every machine; what a finger or a deadline leaves, by what
// estimates take here. A window every so often is asked for by a finger that moves on (T1), from when it
// does; nobody waits for it before, so that others' turns do not count. What is of use until a deadline only
// leaves less with every one of them.
ModulusBudget ImagingLane::modulus_budget(const EstimateRequest& r, const JobTerms& terms,
                                          double begun_s) const {
  const EstimateSize size = r.size();
  ModulusBudget budget = usual_modulus(size).within(
      size.modulus_time_limit_s,
      fmt::format("{} allows {:.3g} s", r.modulus_time_limit_s ? "modulus_time_limit_s" : "the service",
                  size.modulus_time_limit_s));
  const double publishing_s = cost_.expected_publishing_s(size);
  const auto leave = [&](double left_s, const std::string& words) {
    const std::string why = fmt::format("{:.2f} s are left of {}", std::max(0.0, left_s), words);
    budget.restrict_to(cost_.budget(size, left_s, why));
  };
  if (r.scene && !r.modulus_time_limit_s) {
    const auto& v = r.scene->finger().now().velocity_m_s;
    const double speed = std::max(choices::kSlowFinger, std::hypot(v[0], v[1], v[2])),
                 window_s = kOfCrossing * r.window_width_m() / speed;
    leave(window_s - (worked_s() - begun_s) - publishing_s,
          fmt::format("{:.2f} s, {:.0f} % of what a finger at {:.0f} mm/s takes to cross a window", window_s,
                      100 * kOfCrossing, 1e3 * speed));
  }
  if (terms.deadline != JobTerms::Time::max())
    leave(Seconds(terms.deadline - Clock::now()).count() - publishing_s, "the deadline");
  return budget;
}

void ImagingLane::refuse_the_hopeless(const EstimateRequest& request, const JobTerms& asked) {
  JobTerms terms = this->terms(request, asked);
  terms.cost_s = min_s(request);
  require_in_time(request, terms, terms.cost_s,
                  "acquisition.finish_within_s: by itself such an estimate could be done in {:.1f} s; "
                  "allow more, or send a smaller frame or a smaller modulus_time_limit_s");
}

JobTerms ImagingLane::admit(const EstimateRequest& request, const JobTerms& asked) {
  JobTerms terms = this->terms(request, asked);
  const auto late = [&] {
    return workers_.done_in_s(terms) > Seconds(terms.deadline - Clock::now()).count();
  };
  if (late()) terms.cost_s = min_s(request);
  require_in_time(
      request, terms, workers_.done_in_s(terms),
      "not to be done in time beside what is being served; it could be done in {:.1f} s: allow so "
      "much (acquisition.finish_within_s, the call's deadline), or try again later");
  return terms;
}

// What another device has published meanwhile is newer.
void ImagingLane::require_here(const EstimateRequest& request) const {
  if (request.scene && !options_.images(request.scene))
    throw Error(ErrorKind::kUnavailable, "another device has taken the scene over; send the pair again");
}

EstimateOutcome ImagingLane::estimate(const EstimateRequest& request, const JobTerms& terms,
                                      Clock::time_point received, const std::function<Frames()>& unpack,
                                      const std::function<void(Stage)>& ended) {
  const double queued_s = Seconds(Clock::now() - received).count(), waited_before_s = waited_s();
  const double begun_s = worked_s();
  const Frames frames = unpack();
  recovery_.require();
  const std::shared_ptr<Device> device = device_;
  const auto imaging = device->imaging();
  try {
    EstimateOutcome outcome = work(request, terms, received, frames, ended);
    outcome.queued_s = queued_s;
    outcome.waited_s = waited_s() - waited_before_s;
    outcome.received_to_published_s = Seconds(Clock::now() - received).count();
    return outcome;
  } catch (const Error& error) {
    if (error.kind == ErrorKind::kDeadline) cost_.late(request.size(), worked_s() - begun_s);
    throw;
  } catch (const DeviceMemoryError&) {  // says nothing of the device
    throw;
  } catch (const DeviceError& error) {
    device_.failed(device, error.what());
    recovery_.require();
    throw Error(ErrorKind::kUnavailable,
                fmt::format("the device failed ({}) and is open again; send the pair again", error.what()));
  }
}

EstimateOutcome ImagingLane::work(const EstimateRequest& r, const JobTerms& terms, Clock::time_point received,
                                  const Frames& frames, const std::function<void(Stage)>& ended) {
  EstimateOutcome outcome;
  require_here(r);
  // What lies beside the window draws stress to itself: the scene tells what it knows of it by now.
  EstimateInput in(r);
  if (r.scene) in.known = known_modulus(r.scene->snapshot()->map);
  if (r.slice_of) {
    const std::shared_ptr<const ExplicitModulus> slices = r.slice_of->scene->solid();
    in.beside = slices_beside(slices, r.slice_of->x_m, r.slice_of->z_m);
    in.told = r.slice_of->scene->told().beside(*slices, r.slice_of->z_m);
  }
  if (r.force) in.modulus.need.common = r.force->deviation();
  if (r.scene) in.modulus.need.tolerance = r.scene->finger().tolerance();
  {
    const auto engine = engines_.borrow(terms.client);
    engine->charge_to({memory_, terms.client});
    engine->set_max_strain(r.max_strain);
    in.modulus.budget = [&, begun_s = worked_s()] { return modulus_budget(r, terms, begun_s); };
    outcome.estimate = engine->estimate(frames.first, frames.second, in, ended);
  }
  const Estimate& e = outcome.estimate;
  if (r.slice_of)
    r.slice_of->scene->told().tell(
        r.slice_of->z_m, e.modulus.told,
        fmt::format("at z = {:.1f} mm: {}", 1e3 * r.slice_of->z_m, e.modulus.model));
  EstimateSeconds took{e.displacement_s + e.strain_s, e.modulus_s, 0, e.modulus.start_s,
                       e.modulus.iterations};
  if (e.modulus.kind == ModulusKind::kSolid) took.steps = e.modulus.solves;
  if (r.scene) {
    const double begun_s = worked_s();
    require_here(r);
    outcome.published = publisher_.publish(r.scene, window_of(r, e, received), terms.client);
    took.publishing = outcome.publish_s = worked_s() - begun_s;
  }
  EstimateSize size = r.size();
  size.method = e.modulus.start_s > 0 ? ModulusKind::kIterative : e.modulus.kind;
  cost_.took(size, took);
  return outcome;
}

}  // namespace teletact::service
