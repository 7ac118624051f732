# Writes r_expressions.json: what R makes of expressions, for tests/race/test_expressions.py.
# Rscript r_expressions.R > r_expressions.json
expressions <- c(
  '100000 == "100000"', '"1e+05" %in% 100000', '100000L == "100000"', '100000 %in% "100000"',
  'as.character(c(100000, 123456, 0.0001, 0.00012, 1e15, 1e-15, 0.1+0.2, 1/3, 1e22, 123456789012, -1e5, 2^31, TRUE))',
  'as.character(100000L)', 'as.character(TRUE)', 'as.character("a")', 'as.character(NA)', 'as.character(1e5 + 0.1)',
  'nchar(NA)', 'nchar(123.5)', 'nchar("h\u00e9")', 'nchar(TRUE)', 'nchar(100000)', 'nchar(c("a", "bb"))',
  'grepl("a", NA)', 'grepl("^a.b$", "axb")', 'grepl("A", "a", ignore.case = TRUE)', 'grepl("A", "a")',
  'grepl(".", "a", fixed = TRUE)', 'grepl("[[:digit:]]+", 12)', 'grepl("^[^[:alpha:]]$", "a")',
  'grepl("a", c("a", "b"))', 'grepl(x = "ab", pattern = "b$")',
  'seq(3)', 'seq(0)', 'seq(2, 5)', 'seq(5, 2)', 'seq(1, 10, by = 3)', 'seq(1, 10, 3)', 'seq(0, 1, by = 0.1)',
  'seq(0, 1, length.out = 3)', 'seq(1, 2, length = 4)', 'seq(10, 1, by = -4)', 'seq(c(5, 6, 7))', 'seq(1.5, 4)',
  'seq(2, by = 2, length.out = 3)', 'seq(to = 5, length.out = 3)', 'seq(4, 4, by = 2)', 'seq(by = 2, to = 7)',
  '1:3', '3:1', '1.5:4', '-1:2', '1:3 %in% 2', '2 %in% 1:3', '1:0', '-(1:3)', '1:3 + 1', '2 * 1:3', '1:2:4',
  'xor(TRUE, NA)', 'xor(TRUE, FALSE)', 'xor(1, 0)', 'xor(TRUE, TRUE)', 'xor(c(TRUE, FALSE), TRUE)',
  'ifelse(NA, 1, 2)', 'ifelse(TRUE, "a", 2)', 'ifelse(0, "a", 2)', 'ifelse("T", 1, 2)', 'ifelse(c(TRUE, FALSE), 1, 2)',
  'any(NA, TRUE)', 'any(NA, FALSE)', 'any(FALSE)', 'any(0, 2)', 'any(c(1, 2) == 2)', 'any(NA, na.rm = TRUE)', 'any()',
  'all(TRUE, NA)', 'all(FALSE, NA)', 'all(c(1, 2) > 0, TRUE)', 'all(NA, na.rm = TRUE)', 'sum(c(1, 2), 3)',
  'as.integer("3.7")', 'as.integer(-3.7)', 'as.integer("x")', 'as.integer(3e9)', 'as.integer("0x1A")',
  'as.integer(TRUE)', 'as.integer("TRUE")', 'as.integer(" 4 ")', 'as.integer(c(1.5, 2))',
  'as.numeric("0x1A")', 'as.numeric("0x1.8p1")', 'as.numeric("infinity") > 1e308', 'as.numeric("NA")', 'as.numeric("1d2")',
  'as.numeric("1L")', 'as.numeric("-0x10")', 'as.numeric(".")', 'as.numeric("1.")', 'as.numeric("\u0661")',
  'as.numeric("")', 'as.numeric(c("1", "b"))', 'as.logical("yes")', 'as.logical("1")', 'as.logical("T")',
  'sqrt(-1)', 'sqrt(4)', 'abs(-3)', 'abs(-3L)', 'abs(TRUE)', 'exp(1)', 'log10(1000)', 'log2(8)', 'log10(-1)',
  'log(8, base = 2)', 'log(1000, 10)', 'log(exp(2))', 'exp(1000) == Inf', 'log10(0) == -Inf',
  'TRUE %in% c(1, "a")', '"TRUE" %in% c(TRUE, 0)', 'TRUE %in% c(TRUE, 0)', '1 %in% c(TRUE, FALSE)',
  '"1" %in% c(1, "a")', '0.3 %in% seq(0, 1, by = 0.1)', '0.3 %in% c(0.1+0.2)', '"0.3" %in% c(0.1+0.2)',
  'NA %in% c(1, NA)', '1 %in% c("1.0", "2")', '2 %in% "2"', 'c(1, c(2, 3))', 'c(TRUE, 2)', 'c(1, "a", TRUE)',
  'c(TRUE, "a")', 'c(1L, 2.5)', 'c("a", 100000)', 'c(1, 2) == 2', '!c(TRUE, FALSE)', 'c(TRUE, NA) & c(FALSE, TRUE)',
  'c(FALSE, NA) | TRUE', '1 == "1"', '1.0 == "1.0"', 'TRUE == "TRUE"', '"b" > 3', 'round(-2.5)', 'round(0.15, 1)',
  'round(2.675, 2)', 'round(1234.5, -2)', 'round(5, digits = 1)', 'min(c(3, 1, 2))', 'max(1, c(4, 2))',
  'min(NA, 1, na.rm = TRUE)', 'max(NA, 1)', '"a" == NA', '5 %/% 0.3', '-5 %/% 3', '5.5 %% 2', '1e5L', '0x10',
  '7 %in% 0x7', '2 ^ -1', 'is.na(c(1, NA))', 'floor(c(1.5, -1.5))'
)
quoted <- function(x) paste0('"', gsub('"', '\\\\"', gsub('\\\\', '\\\\\\\\', x)), '"')
member <- function(x)
  if (is.na(x)) 'null' else if (is.logical(x)) tolower(x) else if (is.character(x)) quoted(x) else sprintf('%.17g', x)
json <- function(x) if (length(x) == 1) member(x) else paste0('[', paste(sapply(x, member), collapse = ', '), ']')
rows <- sapply(expressions, function(text) {
  value <- suppressWarnings(eval(parse(text = text)))
  sprintf('  [%s, %s, %s]', quoted(text), quoted(typeof(value)), json(value))
})
cat(sprintf('{\n"made_by": %s,\n"values": [\n%s\n]\n}\n', quoted(R.version.string), paste(rows, collapse = ',\n')))
