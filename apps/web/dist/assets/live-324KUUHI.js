import{a,b,c}from"./chunk-PLJBOOI7.js";import"./chunk-JROY6N4P.js";import"./chunk-ZGCLVE7V.js";export{c as Live,b as LiveFigures,a as WALL};
