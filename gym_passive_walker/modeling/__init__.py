"""Systems that users state themselves: equations derived from where masses are."""
