// What goes to the page in one message: one slot for each channel that has something new. Little-endian.
//
//   header  u32 "TTLT", u32 number of the frame, u32 slots, u32 0
//   slot    u32 channel, u32 bytes of JSON, u32 bytes of data, u32 0; JSON; data; both padded to 8 bytes
//
// The JSON of a slot says what it is, and of its data, under "arrays", name, type, shape and where each
// begins: typed arrays look into the message as it is.
#pragma once

#include <cstdint>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace teletact::client {

enum class Channel : std::uint32_t {
  kTrace = 0,
  kStatus,
  kScene,
  kMap,
  kTactile,
  kWindows,
  kTimeline,
  kBMode,
  kSurface
};
inline constexpr std::size_t kChannels = 9;

// The contents of a slot.
class Slot {
 public:
  explicit Slot(nlohmann::json json = nlohmann::json::object()) : json_(std::move(json)) {}

  template <class Value>
  void add(const char* name, const std::vector<std::size_t>& shape, const std::vector<Value>& values) {
    static_assert(sizeof(Value) == 1 || sizeof(Value) == 4 || sizeof(Value) == 8);
    const char* const type = sizeof(Value) == 1 ? "uint8" : sizeof(Value) == 4 ? "float32" : "float64";
    json_["arrays"].push_back({{"name", name}, {"type", type}, {"shape", shape}, {"at", data_.size()}});
    data_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value));
    data_.resize((data_.size() + 7) / 8 * 8);
  }
  // What else is to be known of the array that was added last.
  void of_array(const nlohmann::json& more) { json_["arrays"].back().update(more); }
  void set(const char* name, nlohmann::json value) { json_[name] = std::move(value); }
  std::string bytes(Channel) const;

 private:
  nlohmann::json json_;
  std::string data_;
};

// Of slots' bytes.
std::string frame(std::uint32_t number, const std::vector<std::shared_ptr<const std::string>>& slots);

}  // namespace teletact::client
