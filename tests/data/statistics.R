# Writes statistics.json: what R makes of small samples, for tests/studies/test_statistics.py.
# Rscript statistics.R > statistics.json     (R 4.2.2; packages jsonlite 1.8 and coin 1.4)
suppressPackageStartupMessages({library(coin); library(jsonlite)})

rank_sums <- list(
  list(x = c(1.1, 2.2, 0.3, 4.4, 5.5), y = c(6.1, 3.2, 7.3, 8.4)),
  list(x = c(0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46), y = c(1.15, 0.88, 0.90, 0.74, 1.21)),
  list(x = 1:12 + 0.5, y = c(3, 4, 11, 19, 22, 25, 26, 27, 30)),
  list(x = c(1, 2, 2, 3, 5), y = c(2, 3, 4, 4, 6, 7)),
  list(x = c(0, 0, 0, 0, 0, 0, 3, 4, 5, 6), y = rep(0, 10)),
  list(x = c(10, 10, 10, 12, 14, 14, 9, 8), y = c(10, 14, 14, 15, 15, 16, 17, 14, 10)),
  list(x = (1:60 * 37) %% 101, y = (1:55 * 53) %% 103 + 7.5)
)
pairs <- list(
  list(x = c(1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30),
       y = c(0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29)),
  list(x = c(5, 7, 9, 4, 6, 8, 10, 3), y = c(4, 6, 7, 6, 3, 4, 5, 2)),
  list(x = c(1, 2, 3, 4, 5, 6, 7, 8, 9, 10), y = c(1, 2, 2, 6, 3, 9, 5, 5, 5, 4)),
  list(x = (1:70 * 31) %% 71 + 0.25, y = (1:70 * 29) %% 73)
)
friedmans <- list(
  rbind(c(5.40, 5.50, 5.55), c(5.85, 5.70, 5.75), c(5.20, 5.60, 5.50), c(5.55, 5.50, 5.40), c(5.90, 5.85, 5.70)),
  rbind(c(1, 2, 2, 4), c(3, 1, 2, 2), c(5, 5, 6, 7), c(1, 4, 2, 3), c(9, 8, 8, 8), c(2, 2, 3, 4))
)
adjusted <- list(c(0.01, 0.02, 0.03, 0.04, 0.05), c(0.5, 0.001, 0.2, 0.001, 0.04, 0.9), c(0.3))
strata <- list(
  list(x = list(c(1.1, 2.2, 0.3), c(10, 20, 20, 50)), y = list(c(6.1, 3.2, 7.3, 0.1), c(20, 60, 70))),
  list(x = list(c(5, 6, 7, 9), c(1, 2, 3), c(0.1, 0.2, 0.25, 0.3)), y = list(c(1, 2, 8), c(4, 5, 6), c(0.15, 0.4)))
)
permuted <- function(x, y) {  # all ways to deal the values, twice the smaller tail
  ranks <- rank(c(x, y)); found <- sum(ranks[seq_along(x)]); sums <- combn(ranks, length(x), sum)
  min(1, 2 * min(mean(sums <= found + 1e-9), mean(sums >= found - 1e-9)))
}
van_elteren <- function(s) {  # ranks of each stratum divided by its size + 1, asymptotic
  rows <- do.call(rbind, lapply(seq_along(s$x), function(k) rbind(
    data.frame(value = s$x[[k]], group = "x", stratum = k), data.frame(value = s$y[[k]], group = "y", stratum = k))))
  rows$group <- factor(rows$group); rows$stratum <- factor(rows$stratum)
  rows$score <- ave(rows$value, rows$stratum, FUN = function(v) rank(v) / (length(v) + 1))
  as.numeric(pvalue(independence_test(score ~ group | stratum, data = rows, teststat = "quadratic")))
}
nemenyi <- function(m) {  # of all pairs of columns, in the order of combn
  ranks <- colMeans(t(apply(m, 1, rank))); k <- ncol(m)
  combn(k, 2, function(p) ptukey(
    abs(ranks[p[1]] - ranks[p[2]]) / sqrt(k * (k + 1) / (6 * nrow(m))) * sqrt(2), k, Inf, lower.tail = FALSE))
}
p <- function(test) suppressWarnings(test)$p.value
result <- list(
  rank_sum = lapply(rank_sums, function(s) c(s, list(
    "wilcox.test(x, y)" = p(wilcox.test(s$x, s$y)),
    "wilcox.test(x, y, exact = FALSE)" = p(wilcox.test(s$x, s$y, exact = FALSE)),
    "combn(rank(c(x, y)), length(x), sum)" = if (length(s$x) + length(s$y) <= 20) permuted(s$x, s$y)))),
  signed_rank = lapply(pairs, function(s) c(s, list(
    "wilcox.test(x, y, paired = TRUE)" = p(wilcox.test(s$x, s$y, paired = TRUE))))),
  friedman = lapply(friedmans, function(m) list(
    rows = m, "friedman.test(rows)" = p(friedman.test(m)),
    "friedman.test(rows)$statistic" = unname(friedman.test(m)$statistic), "ptukey" = nemenyi(m))),
  holm = lapply(adjusted, function(v) list(p = I(v), "p.adjust(p, 'holm')" = I(p.adjust(v, "holm")))),
  van_elteren = lapply(strata, function(s) c(s, list("coin::independence_test" = van_elteren(s))))
)
cat(toJSON(result, auto_unbox = TRUE, digits = I(17), pretty = TRUE), "\n")
