// A table of figures over many seeds: how many are wanted, and a row for each figure with its bar.
#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

namespace autocal_vio {

inline int seeds(int standard) {
  const char* wanted = std::getenv("AUTOCAL_VIO_SEEDS");
  return wanted ? std::atoi(wanted) : standard;
}

// Of simulated motion: `full` with the full table's seeds.
inline double secondsOr(double standard, double full) {
  const char* wanted = std::getenv("AUTOCAL_VIO_SECONDS");
  return wanted ? std::atof(wanted) : std::getenv("AUTOCAL_VIO_SEEDS") ? full : standard;
}

// A few seeds do not tell 2 from 2.5.
inline bool fullTable() {
  return seeds(0) >= 50;
}

// A row of the table: the figure, its bar, and whether it holds.
inline void expectRow(const char* name, const char* figure, double value, const char* relation, double bar,
                      bool holds) {
  std::printf("%s | %-44s | %8.3f | %s %g | %s\n", name, figure, value, relation, bar,
              holds ? "pass" : "FAIL");
  EXPECT_TRUE(holds) << name << ": " << figure;
}

inline void expectBelow(const char* name, const char* figure, double value, double bar) {
  expectRow(name, figure, value, "below", bar, value < bar);
}

inline void expectAtLeast(const char* name, const char* figure, double value, double bar) {
  expectRow(name, figure, value, "at least", bar, value >= bar);
}

inline void expectAbove(const char* name, const char* figure, double value, double bar) {
  expectRow(name, figure, value, "above", bar, value > bar);
}

}  // namespace autocal_vio
