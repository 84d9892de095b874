#include "client/files/matlab/v5_elements.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <optional>
#include <string_view>

#include "client/files/file_io.h"

namespace teletact::client {
namespace {

constexpr std::size_t kTagBytes = 8;
// Flags, dimensions, a name of at most 63 bytes and the tag of the numbers take less.
constexpr std::size_t kHeadBytes = 4096;

enum Type : std::uint32_t { kInt8 = 1, kInt32 = 5, kUint32 = 6, kMatrix = 14, kCompressed = 15 };

// 0: of no numbers.
std::size_t value_bytes(std::uint32_t type) {
  constexpr std::array<std::uint8_t, 14> kBytes{0, 1, 1, 2, 2, 4, 4, 4, 0, 8, 0, 0, 8, 8};
  return type < kBytes.size() ? kBytes[type] : 0;
}

std::uint32_t word(std::string_view bytes, std::size_t at, bool swapped) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return swapped ? __builtin_bswap32(value) : value;
}

struct Element {
  std::uint32_t type = 0;
  std::size_t bytes = 0;  // that it claims
  std::string_view data;  // that are there
};

// Takes the first element off `rest`; none where there is no whole tag.
std::optional<Element> take(std::string_view& rest, bool swapped) {
  if (rest.size() < kTagBytes) return std::nullopt;
  const std::uint32_t first = word(rest, 0, swapped);
  const bool is_short = first >> 16 != 0;  // its data lie in the tag
  Element out{is_short ? first & 0xffff : first, is_short ? first >> 16 : word(rest, 4, swapped), {}};
  out.data = rest.substr(is_short ? kTagBytes / 2 : kTagBytes).substr(0, out.bytes);
  const std::size_t whole = is_short ? kTagBytes : kTagBytes + (out.bytes + 7) / 8 * 8;
  rest.remove_prefix(std::min(whole, rest.size()));
  return out;
}

std::string inflated_head(const std::string& compressed) {
  std::string out(kHeadBytes, '\0');
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK) return {};
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(compressed.data()));
  stream.avail_in = static_cast<uInt>(compressed.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  inflate(&stream, Z_SYNC_FLUSH);
  inflateEnd(&stream);
  return out.substr(0, out.size() - stream.avail_out);
}

// `rest`: of a matrix, as much of it as was read. True where it is the variable and its numbers do not fit.
bool misfits(std::string_view rest, bool swapped, const std::string& variable) {
  const auto flags = take(rest, swapped), dimensions = take(rest, swapped), name = take(rest, swapped),
             numbers = take(rest, swapped);
  if (!numbers || flags->type != kUint32 || flags->data.size() < 4 || dimensions->type != kInt32 ||
      dimensions->data.size() != dimensions->bytes || name->type != kInt8 || name->data != variable)
    return false;
  constexpr std::uint32_t kFirstNumeric = 6, kLastNumeric = 15;  // classes: double to uint64
  const std::uint32_t kind = word(flags->data, 0, swapped) & 0xff;
  if (kind < kFirstNumeric || kind > kLastNumeric) return false;
  long double bytes = static_cast<long double>(value_bytes(numbers->type));
  for (std::size_t at = 0; at + 4 <= dimensions->bytes; at += 4) bytes *= word(dimensions->data, at, swapped);
  return bytes != static_cast<long double>(numbers->bytes);
}

}  // namespace

// matio fills what is missing with whatever lay in memory and reports success, so the chain of elements (a
// header of 128 bytes, then tags of type and size) is walked here first: it must end where the file ends.
void require_whole_v5(const std::filesystem::path& path, std::size_t file_bytes,
                      const std::string& variable) {
  std::ifstream in(path, std::ios::binary);
  std::array<char, 128> header{};
  in.read(header.data(), header.size());
  // The text before is free; bytes 124 to 127 hold version 0x0100 and the letters of the byte order. v7.3 is
  // 0x0200: HDF5 checks its own length.
  const bool swapped = header[126] == 'M' && header[127] == 'I';
  const bool v5 = swapped ? header[124] == 1 && header[125] == 0 : header[124] == 0 && header[125] == 1;
  if (!in || !v5) return;
  std::uint64_t at = header.size();
  while (at < file_bytes) {
    std::string head(static_cast<std::size_t>(std::min<std::uint64_t>(2 * kHeadBytes, file_bytes - at)),
                     '\0');
    in.seekg(static_cast<std::streamoff>(at));
    in.read(head.data(), static_cast<std::streamsize>(head.size()));
    if (!in || head.size() < kTagBytes) break;
    const std::uint32_t type = word(head, 0, swapped), bytes = word(head, 4, swapped);
    at += kTagBytes + bytes;
    head = head.substr(kTagBytes, bytes);
    if (type == kCompressed) {
      head = inflated_head(head);
      if (head.size() < kTagBytes || word(head, 0, swapped) != kMatrix) continue;
      head.erase(0, kTagBytes);
    }
    if ((type == kMatrix || type == kCompressed) && misfits(head, swapped, variable))
      throw FileError(path,
                      "variable '" + variable +
                          "' holds another number of values than it claims; the file is damaged: export it "
                          "again");
  }
  if (at != file_bytes) throw FileError(path, "is truncated or damaged; copy or export it again");
}

}  // namespace teletact::client
