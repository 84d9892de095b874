#include "client/watch/frame.h"

namespace teletact::client {
namespace {

constexpr std::uint32_t kMagic = 0x544c5454;  // "TTLT"

void add_word(std::string& out, std::uint32_t value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

void pad(std::string& out) {
  out.resize((out.size() + 7) / 8 * 8);
}

}  // namespace

std::string Slot::bytes(Channel channel) const {
  // A text of a peer that is no UTF-8 is shown as far as it is.
  const std::string json = json_.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  std::string out;
  out.reserve(json.size() + data_.size() + 32);
  add_word(out, static_cast<std::uint32_t>(channel));
  add_word(out, static_cast<std::uint32_t>(json.size()));
  add_word(out, static_cast<std::uint32_t>(data_.size()));
  add_word(out, 0);
  out += json;
  pad(out);
  out += data_;
  return out;
}

std::string frame(std::uint32_t number, const std::vector<std::shared_ptr<const std::string>>& slots) {
  std::string out;
  for (const std::uint32_t word : {kMagic, number, static_cast<std::uint32_t>(slots.size()), 0U})
    add_word(out, word);
  for (const auto& slot : slots) out += *slot;
  return out;
}

}  // namespace teletact::client
