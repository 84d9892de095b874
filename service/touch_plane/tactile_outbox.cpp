#include "service/touch_plane/tactile_outbox.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stdexcept>
#include <utility>

#include "service/base/choices.h"

namespace teletact::service {

namespace {

TaxelGrid checked(const TaxelGrid& grid) {
  const auto check = [](const char* field, std::size_t taxels) {
    if (taxels >= 1 && taxels <= TactileOutbox::kMaxTaxels) return;
    throw std::invalid_argument(fmt::format("open.tactile.{}: {} is not within [1, {}]; leave it out for 8",
                                            field, taxels, TactileOutbox::kMaxTaxels));
  };
  check("taxels_x", grid.along_x);
  check("taxels_z", grid.along_z);
  if (!(grid.pitch_m >= TactileOutbox::kMinPitchM && grid.pitch_m <= TactileOutbox::kMaxPitchM))
    throw std::invalid_argument(
        fmt::format("open.tactile.pitch_m: {} m is not within [{}, {}]; leave it out for 0.002", grid.pitch_m,
                    TactileOutbox::kMinPitchM, TactileOutbox::kMaxPitchM));
  return grid;
}

}  // namespace

TactileOutbox::TactileOutbox(const TaxelGrid& grid) : grid_(checked(grid)) {}

void TactileOutbox::begin(Clock::time_point now, std::uint64_t sequence, std::function<TactileImage()> make,
                          const TouchWork& work, const std::string& client) {
  auto job = [slot = slot_, sequence, make = std::move(make)] {
    const auto begun = Clock::now();
    std::optional<SentTactile> made;
    try {
      made = SentTactile{sequence, make(), {}};
      made->took = Clock::now() - begun;
    } catch (const std::exception& error) {  // the next may do
      spdlog::warn("event=tactile_not_made error=\"{}\"", error.what());
    }
    if (!made) return;
    const std::lock_guard lock(slot->mutex);
    slot->ready = std::move(made);
  };
  job_.begin(now, choices::kTactilePeriod, std::move(job), work, client);
}

std::optional<SentTactile> TactileOutbox::take() {
  const std::lock_guard lock(slot_->mutex);
  return std::exchange(slot_->ready, std::nullopt);
}

}  // namespace teletact::service
