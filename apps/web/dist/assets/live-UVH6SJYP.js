import{a,b,c}from"./chunk-FO4UCMYT.js";import"./chunk-J7UKHXMV.js";import"./chunk-PCHGCVRS.js";export{c as Live,b as LiveFigures,a as WALL};
