#include "client/files/matfile.h"

#include <gtest/gtest.h>
#include <matio.h>

#include <array>
#include <cstdint>
#include <filesystem>

#include "client/files/matlab/parser_process.h"
#include "tests/files/matlab/hostile_files.h"
#include "tests/files/packed.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

struct Kind {
  const char* name;
  mat_ft version;
  matio_compression compression;
};

void PrintTo(const Kind& kind, std::ostream* out) {
  *out << kind.name;
}

template <class T>
void add(mat_t* mat, const char* name, matio_classes c, matio_types t, std::vector<std::size_t> dims,
         std::vector<T> data, matio_compression compression, int options = 0) {
  matvar_t* v = Mat_VarCreate(name, c, t, static_cast<int>(dims.size()), dims.data(), data.data(), options);
  ASSERT_EQ(Mat_VarWrite(mat, v, compression), 0) << name;
  Mat_VarFree(v);
}

// rf(sample, line) = 100 sample + line, 301 x 4, as double and int16; and things that are no RF.
void write_example(const fs::path& path, const Kind& kind) {
  mat_t* mat = Mat_CreateVer(path.c_str(), nullptr, kind.version);
  ASSERT_NE(mat, nullptr);
  std::vector<double> rf(301 * 4);
  std::vector<std::int16_t> shorts(rf.size());
  for (std::size_t l = 0; l < 4; ++l)
    for (std::size_t k = 0; k < 301; ++k) {
      rf[k + 301 * l] = 100.0 * static_cast<double>(k) + static_cast<double>(l);
      shorts[k + 301 * l] = static_cast<std::int16_t>(rf[k + 301 * l]);
    }
  add(mat, "rf", MAT_C_DOUBLE, MAT_T_DOUBLE, {301, 4}, rf, kind.compression);
  add(mat, "rf16", MAT_C_INT16, MAT_T_INT16, {7, 43, 4}, shorts, kind.compression);
  add(mat, "name", MAT_C_CHAR, MAT_T_UINT8, {1, 3}, std::vector<char>{'a', 'b', 'c'}, kind.compression);
  mat_complex_split_t iq{rf.data(), rf.data()};
  std::array<std::size_t, 2> dims{301, 4};
  matvar_t* v = Mat_VarCreate("iq", MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims.data(), &iq, MAT_F_COMPLEX);
  ASSERT_EQ(Mat_VarWrite(mat, v, kind.compression), 0);
  Mat_VarFree(v);
  Mat_Close(mat);
}

// Every message names the file.
template <class Call>
std::string named_by(const fs::path& path, const Call& call) {
  const std::string message = refusal_of<FileError>(call);
  EXPECT_TRUE(message == "no error" || message.find(path.string()) != std::string::npos) << message;
  return message;
}

std::string message_of(const fs::path& path, const std::string& variable) {
  return named_by(path, [&] { read_mat(path, variable, AxialAxis::kRows); });
}

class MatFile : public testing::TestWithParam<Kind> {};

TEST_P(MatFile, ReadsRowsAndColumnsAsAxial) {
  const TemporaryFolder folder;
  write_example(folder / "a.mat", GetParam());
  const MatFrames rows = read_mat(folder / "a.mat", "rf", AxialAxis::kRows);
  ASSERT_EQ(rows.sample_count, 301u);
  ASSERT_EQ(rows.line_count, 4u);
  EXPECT_EQ(rows.frame_count, 1u);
  for (std::size_t l = 0; l < 4; ++l)
    for (std::size_t k = 0; k < 301; ++k)
      ASSERT_EQ(rows.samples[k + 301 * l], 100.0f * static_cast<float>(k) + static_cast<float>(l));
  const MatFrames columns = read_mat(folder / "a.mat", "rf", AxialAxis::kColumns);
  ASSERT_EQ(columns.sample_count, 4u);
  ASSERT_EQ(columns.line_count, 301u);
  EXPECT_EQ(columns.samples[2 + 4 * 9], 902.0f);
}

TEST_P(MatFile, ReadsFramesOfShorts) {
  const TemporaryFolder folder;
  write_example(folder / "a.mat", GetParam());
  const MatFrames f = read_mat(folder / "a.mat", "rf16", AxialAxis::kRows);
  EXPECT_EQ(f.frame_count, 4u);
  EXPECT_EQ(f.samples[3 + 7 * (2 + 43 * 1)], static_cast<float>(static_cast<std::int16_t>(100 * 17 + 1)));
}

TEST_P(MatFile, NamesTheVariablesThatAreThere) {
  const TemporaryFolder folder;
  write_example(folder / "a.mat", GetParam());
  const std::string message = message_of(folder / "a.mat", "RF");
  for (const char* expected : {"'RF'", "rf", "rf16", "name", "iq"})
    EXPECT_NE(message.find(expected), std::string::npos) << message;
  EXPECT_NE(message_of(folder / "a.mat", "iq").find("complex"), std::string::npos);
  EXPECT_NE(message_of(folder / "a.mat", "name").find("cannot be read as numbers"), std::string::npos);
}

TEST_P(MatFile, RefusesTruncatedFiles) {
  const TemporaryFolder folder;
  write_example(folder / "a.mat", GetParam());
  const std::string whole = content_of(folder / "a.mat");
  for (const double part : {.0, .01, .1, .4, .6}) {
    put_content(folder / "cut.mat",
                whole.substr(0, static_cast<std::size_t>(part * static_cast<double>(whole.size()))));
    const std::string message = message_of(folder / "cut.mat", "iq");
    EXPECT_NE(message, "no error") << part;
  }
}

TEST_P(MatFile, TheHeadersTextIsFreeTruncatedOrNot) {
  if (GetParam().version != MAT_FT_MAT5) return;  // HDF5 has a header of its own
  const TemporaryFolder folder;
  write_example(folder / "a.mat", GetParam());
  std::string whole = content_of(folder / "a.mat");
  whole.replace(0, 24, "Made by a scanner's own ");
  put_content(folder / "text.mat", whole);
  EXPECT_EQ(read_mat(folder / "text.mat", "rf", AxialAxis::kRows).sample_count, 301u);
  put_content(folder / "cut.mat", whole.substr(0, whole.size() / 3));
  EXPECT_NE(message_of(folder / "cut.mat", "rf").find("truncated"), std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(Versions, MatFile,
                         testing::Values(Kind{"v5", MAT_FT_MAT5, MAT_COMPRESSION_NONE},
                                         Kind{"v7", MAT_FT_MAT5, MAT_COMPRESSION_ZLIB},
                                         Kind{"v73", MAT_FT_MAT73, MAT_COMPRESSION_NONE}),
                         [](const auto& info) { return info.param.name; });

TEST(MatFile, RefusesASingleVariableCutAnywhere) {
  const TemporaryFolder folder;
  mat_t* mat = Mat_CreateVer((folder / "a.mat").c_str(), nullptr, MAT_FT_MAT5);
  ASSERT_NE(mat, nullptr);
  add(mat, "rf", MAT_C_DOUBLE, MAT_T_DOUBLE, {50, 40}, std::vector<double>(2000, 3.5), MAT_COMPRESSION_NONE);
  Mat_Close(mat);
  const std::string whole = content_of(folder / "a.mat");
  for (std::size_t bytes = 0; bytes < whole.size() - 8; bytes += 997) {
    put_content(folder / "cut.mat", whole.substr(0, bytes));
    EXPECT_NE(message_of(folder / "cut.mat", "rf"), "no error") << bytes << " of " << whole.size();
  }
}

TEST(MatFile, RefusesWhatIsNoMatlabFile) {
  const TemporaryFolder folder;
  EXPECT_NE(message_of(folder / "absent.mat", "rf").find("does not exist"), std::string::npos);
  put_content(folder / "noise.mat", std::string(5000, 'x'));
  EXPECT_NE(message_of(folder / "noise.mat", "rf").find("MATLAB"), std::string::npos);
}

// What a hostile file can do is an error that names it, and this process goes on.

std::string apart(const fs::path& path, const ParserLimits& limits) {
  return named_by(path, [&] { parse_mat_apart(path, "rf", AxialAxis::kRows, limits); });
}

// Of v5: a header, then elements of a type, a size, and as many bytes, up to a multiple of 8.
std::string v5_of(const std::string& elements) {
  return std::string(116, ' ') + std::string(8, '\0') + std::string("\x00\x01IM", 4) + elements;
}

template <class... Words>
std::string words_of(Words... words) {
  const std::array<std::uint32_t, sizeof...(Words)> all{static_cast<std::uint32_t>(words)...};
  return {reinterpret_cast<const char*>(all.data()), sizeof all};
}

std::string element(std::uint32_t type, const std::string& data) {
  return words_of(type, data.size()) + data + std::string((8 - data.size() % 8) % 8, '\0');
}

// 1 x `columns`; what is in it follows.
std::string array_head(matio_classes kind, std::uint32_t columns, const std::string& name) {
  return element(MAT_T_UINT32, words_of(kind, 0)) + element(MAT_T_INT32, words_of(1, columns)) +
         element(MAT_T_INT8, name);
}

std::string doubles(std::uint32_t columns, const std::string& name, std::size_t there) {
  return element(MAT_T_MATRIX, array_head(MAT_C_DOUBLE, columns, name) +
                                   element(MAT_T_DOUBLE, std::string(8 * there, '\0')));
}

TEST(HostileMatFile, CellsWithinCellsEndTheirParserAlone) {
  constexpr std::size_t kDeep = 100'000;
  const std::string innermost = doubles(1, "", 1), head = array_head(MAT_C_CELL, 1, "");
  const std::size_t cell_bytes = 8 + head.size();
  std::string cells;
  for (std::size_t k = 0; k < kDeep; ++k)
    cells += words_of(MAT_T_MATRIX, (kDeep - k) * cell_bytes - 8 + innermost.size()) + head;
  const TemporaryFolder folder;
  put_content(folder / "deep.mat", v5_of(cells + innermost));
  const std::string message = message_of(folder / "deep.mat", "rf");
  EXPECT_NE(message.find("its parser ended before it was done"), std::string::npos) << message;
}

// By fuzzers: what makes matio or HDF5 read or claim beyond what there is. It ends their parser at most.
TEST(HostileMatFile, ThoseThatWereFoundAreRefused) {
  int found = 0;
  for (const auto& entry : fs::directory_iterator(hostile_files())) {
    if (entry.path().extension() != ".mat") continue;
    ++found;
    EXPECT_NE(message_of(entry.path(), "rf"), "no error") << entry.path();
  }
  EXPECT_EQ(found, 2);
}

TEST(HostileMatFile, ClaimsOfMoreThanItHoldsAreRefused) {
  const TemporaryFolder folder;
  for (const std::uint32_t columns : {1U << 10, 1U << 20, 1U << 30, 0x7fffffffU, 0xffffffffU}) {
    put_content(folder / "huge.mat", v5_of(doubles(columns, "rf", 8)));
    const std::string message = message_of(folder / "huge.mat", "rf");
    EXPECT_NE(message.find("holds another number of values than it claims"), std::string::npos) << message;
  }
}

// matio would fill the frame with whatever lay in memory.
TEST(HostileMatFile, ShortCompressedVariableIsRefused) {
  const TemporaryFolder folder;
  const std::string whole = doubles(64, "rf", 64), less = doubles(64, "rf", 63);
  for (const std::string& matrix : {whole, less}) {
    const std::string variable = packed(matrix);
    put_content(folder / "packed.mat", v5_of(words_of(MAT_T_COMPRESSED, variable.size()) + variable));
    const std::string message = message_of(folder / "packed.mat", "rf");
    if (matrix == whole)
      EXPECT_EQ(message, "no error");
    else
      EXPECT_NE(message.find("holds another number of values than it claims"), std::string::npos) << message;
  }
}

// A bomb: 36 MiB of zeros in 40 kB, of which 144 MiB of floats are made.
TEST(HostileMatFile, ExceededLimitSaysWhatToDo) {
  const TemporaryFolder folder;
  mat_t* mat = Mat_CreateVer((folder / "bomb.mat").c_str(), nullptr, MAT_FT_MAT5);
  ASSERT_NE(mat, nullptr);
  constexpr std::size_t kSide = 6144;
  add(mat, "rf", MAT_C_INT8, MAT_T_INT8, {kSide, kSide}, std::vector<std::int8_t>(kSide * kSide),
      MAT_COMPRESSION_ZLIB);
  Mat_Close(mat);
  ASSERT_LT(fs::file_size(folder / "bomb.mat"), std::uintmax_t{1} << 20);
  ParserLimits limits;
  limits.silence = std::chrono::seconds(0);
  EXPECT_NE(apart(folder / "bomb.mat", limits).find("was not read within 0 s"), std::string::npos);
  limits = {};
  limits.address_bytes = std::size_t{144} << 20;
  const std::string message = apart(folder / "bomb.mat", limits);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they bound no addresses
  EXPECT_NE(message.find("takes more than 144 MiB to read; save fewer frames"), std::string::npos) << message;
#endif
  EXPECT_EQ(read_mat(folder / "bomb.mat", "rf", AxialAxis::kRows).samples.size(), kSide * kSide);
}

TEST(HostileMatFile, NamesInItCannotDrawOnTheTerminal) {
  const TemporaryFolder folder;
  put_content(folder / "names.mat", v5_of(doubles(1, "a\x1b[2J\n" + std::string(100, 'b'), 1)));
  const std::string message = message_of(folder / "names.mat", "rf");
  EXPECT_NE(message.find("has no variable"), std::string::npos) << message;
  EXPECT_EQ(message.find_first_of("\x1b\n"), std::string::npos) << message;
}

}  // namespace
}  // namespace teletact::client
